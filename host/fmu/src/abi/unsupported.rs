//! C functions that the standards want exported and this FMU does not support: they return an error
//! with a message. Functions for types that no variable has accept an empty list; those that make
//! another kind of FMU return null.
//!
//! Arguments beyond those declared here are not looked at. The C calling conventions of the platforms
//! for which there are FMUs (System V and Microsoft on x86-64, AAPCS64) leave them to the caller.

use std::ffi::c_void;

use super::Status;
use crate::refusal::Refusal;

/// Functions of an instance.
macro_rules! unsupported {
    ($($name:ident)*) => {$(
        /// Not supported.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $name(instance: *mut c_void) -> Status {
            let run = |_: &mut _| Err(Refusal::Unsupported(stringify!($name)));
            // SAFETY: an instance, by the standard.
            unsafe { super::call(instance, stringify!($name), run) }
        }
    )*};
}

/// Functions for types that no variable has: right for no value, else an error.
macro_rules! no_variable {
    ($($name:ident)*) => {$(
        /// There is no variable of this type.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $name(
            instance: *mut c_void,
            references: *const u32,
            n: usize,
        ) -> Status {
            let run = |instance: &mut crate::instance::Instance| {
                // SAFETY: `n` references, by the standard.
                let references = unsafe { super::memory::input(references, n, "valueReferences")? };
                references.first().map_or(Ok(()), |first| Err(instance.other_type(*first)))
            };
            // SAFETY: an instance, by the standard.
            unsafe { super::call(instance, stringify!($name), run) }
        }
    )*};
}

/// Other kinds of FMU.
macro_rules! no_instance {
    ($($name:ident)*) => {$(
        /// Not supported: null.
        #[unsafe(no_mangle)]
        extern "C" fn $name() -> *mut c_void {
            std::ptr::null_mut()
        }
    )*};
}

no_instance!(fmi3InstantiateModelExchange fmi3InstantiateScheduledExecution);

no_variable!(
    fmi3GetFloat32 fmi3SetFloat32 fmi3GetInt8 fmi3SetInt8 fmi3GetUInt8 fmi3SetUInt8
    fmi3GetInt16 fmi3SetInt16 fmi3GetUInt16 fmi3SetUInt16 fmi3GetUInt32 fmi3SetUInt32
    fmi3GetInt64 fmi3SetInt64 fmi3GetUInt64 fmi3SetUInt64 fmi3GetString fmi3SetString
    fmi3GetBinary fmi3SetBinary fmi3GetClock fmi3SetClock
    fmi2GetString fmi2SetString
);

unsupported!(
    fmi3EnterEventMode fmi3EnterStepMode fmi3EnterConfigurationMode fmi3ExitConfigurationMode
    fmi3GetDirectionalDerivative fmi3GetAdjointDerivative fmi3GetOutputDerivatives
    fmi3GetIntervalDecimal fmi3GetIntervalFraction fmi3SetIntervalDecimal fmi3SetIntervalFraction
    fmi3GetShiftDecimal fmi3GetShiftFraction fmi3SetShiftDecimal fmi3SetShiftFraction
    fmi3EvaluateDiscreteStates fmi3UpdateDiscreteStates
    fmi3EnterContinuousTimeMode fmi3CompletedIntegratorStep fmi3SetTime fmi3SetContinuousStates
    fmi3GetContinuousStateDerivatives fmi3GetEventIndicators fmi3GetContinuousStates
    fmi3GetNominalsOfContinuousStates fmi3GetNumberOfEventIndicators
    fmi3GetNumberOfContinuousStates fmi3ActivateModelPartition
    fmi2GetDirectionalDerivative fmi2SetRealInputDerivatives fmi2GetRealOutputDerivatives
    fmi2CancelStep fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus fmi2GetBooleanStatus
    fmi2GetStringStatus
);
