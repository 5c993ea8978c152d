//! The command `loadtwin schema`: prints the JSON schema of the machine description, generated from
//! the type `Machine`.

use super::printing::say;
use crate::machine::Machine;

/// The schema that editors complete and check a machine description with.
///
/// # Errors
/// When the schema cannot be written.
pub fn run() -> anyhow::Result<()> {
    say!(
        "{}",
        serde_json::to_string_pretty(&schemars::schema_for!(Machine))?
    );
    Ok(())
}
