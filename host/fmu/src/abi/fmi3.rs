//! C functions of FMI 3.0 for co-simulation: instance, initialisation, step, variables,
//! dependencies, saved states.

use std::ffi::{CString, c_char, c_void};
use std::path::Path;

use super::native::{Array, Byte};
use super::{Log, OK, Status, memory, state};
use crate::instance::Instance;
use crate::refusal::{Phase, Refusal};
use crate::resources::Resources;

/// `fmi3LogMessageCallback`: environment, status, category, message.
type LogMessage = Option<unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char)>;

/// Messages to `callback`.
fn log(environment: *mut c_void, callback: LogMessage) -> Log {
    Box::new(move |message| {
        if let (Some(callback), Ok(message)) = (callback, CString::new(message)) {
            let category = c"logStatusError".as_ptr();
            // SAFETY: the environment's own function, with texts that live during the call.
            unsafe { callback(environment, super::ERROR, category, message.as_ptr()) }
        }
    })
}

/// Version of the standard.
#[unsafe(no_mangle)]
extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Errors are always logged, and nothing else.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3SetDebugLogging(
    instance: *mut c_void,
    _on: Byte,
    _n: usize,
    _categories: *const *const c_char,
) -> Status {
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi3SetDebugLogging", |_| Ok(())) }
}

/// Makes an instance of the files in the folder `resource_path`.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resource_path: *const c_char,
    _visible: Byte,
    _logging: Byte,
    event_mode: Byte,
    _early_return: Byte,
    _intermediate: *const u32,
    n_intermediate: usize,
    environment: *mut c_void,
    log_message: LogMessage,
    _intermediate_update: *const c_void,
) -> *mut c_void {
    super::instantiate(log(environment, log_message), || {
        if event_mode.0 != 0 {
            return Err(Refusal::Unsupported("eventModeUsed"));
        }
        memory::same_length(0, n_intermediate)?;
        // SAFETY: texts, by the standard.
        let token = unsafe { memory::text(token, "instantiationToken")? };
        // SAFETY: the same.
        let folder = unsafe { memory::text(resource_path, "resourcePath")? };
        Instance::new(&Resources::read(Path::new(folder))?, token)
    })
}

/// Frees an instance.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    // SAFETY: the last use of an instance, by the standard.
    unsafe { super::free(instance) }
}

/// Begins the initialisation.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    _tolerance_defined: Byte,
    _tolerance: f64,
    start_s: f64,
    _stop_defined: Byte,
    _stop: f64,
) -> Status {
    const NAME: &str = "fmi3EnterInitializationMode";
    let run = |instance: &mut Instance| {
        instance.go(NAME, Phase::Instantiated, Phase::Instantiated)?;
        instance.start_at(start_s)?;
        instance.go(NAME, Phase::Instantiated, Phase::Initialisation)
    };
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, NAME, run) }
}

/// Ends the initialisation.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> Status {
    const NAME: &str = "fmi3ExitInitializationMode";
    let run = |instance: &mut Instance| instance.go(NAME, Phase::Initialisation, Phase::Stepping);
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, NAME, run) }
}

/// Ends the simulation.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3Terminate(instance: *mut c_void) -> Status {
    const NAME: &str = "fmi3Terminate";
    let run = |instance: &mut Instance| instance.go(NAME, Phase::Stepping, Phase::Terminated);
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, NAME, run) }
}

/// Begins anew.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3Reset(instance: *mut c_void) -> Status {
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi3Reset", Instance::reset) }
}

/// One sample.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    point_s: f64,
    size_s: f64,
    _no_set_state: Byte,
    event_handling_needed: *mut Byte,
    terminate_simulation: *mut Byte,
    early_return: *mut Byte,
    last_successful_time: *mut f64,
) -> Status {
    let run = |instance: &mut Instance| {
        let truths = [
            (event_handling_needed, "eventHandlingNeeded"),
            (terminate_simulation, "terminateSimulation"),
            (early_return, "earlyReturn"),
        ];
        for (truth, name) in truths {
            // SAFETY: place for one truth, by the standard.
            unsafe { memory::write(truth, Byte(0), name)? };
        }
        // SAFETY: place for one time, by the standard.
        let reached = |t| unsafe { memory::write(last_successful_time, t, "lastSuccessfulTime") };
        reached(point_s)?;
        instance.step(point_s, size_s)?;
        reached(point_s + size_s)
    };
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi3DoStep", run) }
}

/// Functions that get and set values of a type that variables have.
macro_rules! values {
    ($($get:ident $set:ident $native:ty),*) => {$(
        /// Gets values.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            n: usize,
            values: *mut $native,
            n_values: usize,
        ) -> Status {
            let (references, values) = (Array(references, n), Array(values, n_values));
            // SAFETY: an instance and arrays of these lengths, by the standard.
            unsafe { super::get(instance, stringify!($get), references, values) }
        }

        /// Sets values.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            n: usize,
            values: *const $native,
            n_values: usize,
        ) -> Status {
            let (references, values) = (Array(references, n), Array(values, n_values));
            // SAFETY: an instance and arrays of these lengths, by the standard.
            unsafe { super::set(instance, stringify!($set), references, values) }
        }
    )*};
}

values!(
    fmi3GetFloat64 fmi3SetFloat64 f64,
    fmi3GetInt32 fmi3SetInt32 i32,
    fmi3GetBoolean fmi3SetBoolean Byte
);

/// Outputs do not depend on inputs of the same time.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi3GetNumberOfVariableDependencies(
    instance: *mut c_void,
    _reference: u32,
    n: *mut usize,
) -> Status {
    // SAFETY: place for a number, by the standard.
    let run = |_: &mut Instance| unsafe { memory::write(n, 0, "nDependencies") };
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi3GetNumberOfVariableDependencies", run) }
}

/// There are none.
#[unsafe(no_mangle)]
extern "C" fn fmi3GetVariableDependencies(instance: *mut c_void) -> Status {
    if instance.is_null() { super::ERROR } else { OK }
}

state::state_functions!(
    fmi3GetFMUState fmi3SetFMUState fmi3FreeFMUState fmi3SerializedFMUStateSize fmi3SerializeFMUState fmi3DeserializeFMUState
);
