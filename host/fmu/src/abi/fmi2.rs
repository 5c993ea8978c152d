//! C functions of FMI 2.0 for co-simulation: instance, experiment, step, variables, saved states.
//! Those that are refused are in `unsupported`.

use std::ffi::{CString, c_char, c_int, c_void};

use super::native::{Array, Int};
use super::{Log, Status, memory, state};
use crate::file_uri;
use crate::instance::Instance;
use crate::refusal::{Phase, Refusal};
use crate::resources::Resources;

/// `fmi2CoSimulation`.
const CO_SIMULATION: c_int = 1;

/// `fmi2CallbackLogger`: environment, instance, status, category, message as of `printf`.
type Logger = Option<
    unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char, ...),
>;

/// `fmi2CallbackFunctions`.
#[repr(C)]
struct Callbacks {
    logger: Logger,
    allocate: *const c_void,
    free: *const c_void,
    step_finished: *const c_void,
    environment: *mut c_void,
}

/// Messages of instance `name` to the environment.
fn log(name: CString, logger: Logger, environment: *mut c_void) -> Log {
    Box::new(move |message| {
        // The message is a format: what it holds of one is text.
        let message = CString::new(message.replace('%', "%%"));
        if let (Some(logger), Ok(message)) = (logger, message) {
            let category = c"logStatusError".as_ptr();
            // SAFETY: the environment's own function, with texts that live during the call and a
            // format without arguments.
            unsafe {
                let name = name.as_ptr();
                logger(environment, name, super::ERROR, category, message.as_ptr());
            }
        }
    })
}

/// Sizes of the types.
#[unsafe(no_mangle)]
extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// Version of the standard.
#[unsafe(no_mangle)]
extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Errors are always logged, and nothing else.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2SetDebugLogging(
    instance: *mut c_void,
    _on: c_int,
    _n: usize,
    _categories: *const *const c_char,
) -> Status {
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi2SetDebugLogging", |_| Ok(())) }
}

/// Makes an instance of the files in the folder of the URI `resource_location`.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resource_location: *const c_char,
    functions: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut c_void {
    // SAFETY: null or callbacks, by the standard.
    let Some(functions) = (unsafe { functions.as_ref() }) else {
        return std::ptr::null_mut();
    };
    // SAFETY: a text, by the standard.
    let name = unsafe { memory::text(name, "instanceName") };
    let name = CString::new(name.unwrap_or_default()).unwrap_or_default();
    let log = log(name, functions.logger, functions.environment);
    super::instantiate(log, || {
        if kind != CO_SIMULATION {
            return Err(Refusal::Unsupported("fmi2ModelExchange"));
        }
        // SAFETY: texts, by the standard.
        let token = unsafe { memory::text(guid, "fmuGUID")? };
        // SAFETY: the same.
        let folder = unsafe { memory::text(resource_location, "fmuResourceLocation")? };
        Instance::new(&Resources::read(&file_uri::path(folder)?)?, token)
    })
}

/// Frees an instance.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2FreeInstance(instance: *mut c_void) {
    // SAFETY: the last use of an instance, by the standard.
    unsafe { super::free(instance) }
}

/// States the time of the first step.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2SetupExperiment(
    instance: *mut c_void,
    _tolerance_defined: c_int,
    _tolerance: f64,
    start_s: f64,
    _stop_defined: c_int,
    _stop: f64,
) -> Status {
    const NAME: &str = "fmi2SetupExperiment";
    let run = |instance: &mut Instance| {
        instance.go(NAME, Phase::Instantiated, Phase::Instantiated)?;
        instance.start_at(start_s)
    };
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, NAME, run) }
}

/// Functions that only go from one phase to the next.
macro_rules! phases {
    ($($name:ident $from:ident $to:ident),*) => {$(
        /// Goes on to the next phase.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $name(instance: *mut c_void) -> Status {
            const NAME: &str = stringify!($name);
            let run = |instance: &mut Instance| instance.go(NAME, Phase::$from, Phase::$to);
            // SAFETY: an instance, by the standard.
            unsafe { super::call(instance, NAME, run) }
        }
    )*};
}

phases!(
    fmi2EnterInitializationMode Instantiated Initialisation,
    fmi2ExitInitializationMode Initialisation Stepping,
    fmi2Terminate Stepping Terminated
);

/// Begins anew.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2Reset(instance: *mut c_void) -> Status {
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi2Reset", Instance::reset) }
}

/// One sample.
#[unsafe(no_mangle)]
unsafe extern "C" fn fmi2DoStep(
    instance: *mut c_void,
    point_s: f64,
    size_s: f64,
    _no_set_state: c_int,
) -> Status {
    let run = |instance: &mut Instance| instance.step(point_s, size_s);
    // SAFETY: an instance, by the standard.
    unsafe { super::call(instance, "fmi2DoStep", run) }
}

/// Functions that get and set values.
macro_rules! values {
    ($($get:ident $set:ident $native:ty),*) => {$(
        /// Gets values.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            n: usize,
            values: *mut $native,
        ) -> Status {
            let (references, values) = (Array(references, n), Array(values, n));
            // SAFETY: an instance and arrays of that length, by the standard.
            unsafe { super::get(instance, stringify!($get), references, values) }
        }

        /// Sets values.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            n: usize,
            values: *const $native,
        ) -> Status {
            let (references, values) = (Array(references, n), Array(values, n));
            // SAFETY: an instance and arrays of that length, by the standard.
            unsafe { super::set(instance, stringify!($set), references, values) }
        }
    )*};
}

values!(
    fmi2GetReal fmi2SetReal f64,
    fmi2GetInteger fmi2SetInteger i32,
    fmi2GetBoolean fmi2SetBoolean Int
);

state::state_functions!(
    fmi2GetFMUstate fmi2SetFMUstate fmi2FreeFMUstate fmi2SerializedFMUstateSize fmi2SerializeFMUstate fmi2DeSerializeFMUstate
);
