//! Options of a run over an archive: sensor set, filter (`aekf`, or `steady` with gains computed
//! beforehand), columns of the estimates that are kept, whether days that are up to date are
//! replayed again, and whether pages are written. `named` checks the names from the command line.

use loadtwin_design::image_build::Filter;
use serde::{Deserialize, Serialize};

use crate::ArchiveError;

/// Columns of the estimates that are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Columns {
    /// Loads, then the innovations of each sensor.
    #[default]
    All,
    /// The loads with their standard deviations and faults.
    Loads,
}

impl Columns {
    /// What `--columns` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Loads => "loads",
        }
    }
}

/// How the machines of an archive are replayed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Options {
    /// Set of sensors; the first of each description where absent.
    pub sensors: Option<String>,
    /// Whether gains computed beforehand are used where they hold (`--filter steady`).
    pub is_steady: bool,
    /// Columns of the estimates that are kept.
    pub columns: Columns,
    /// Replay all days, also those that are up to date.
    pub again: bool,
    /// Write the pages.
    pub page: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sensors: None,
            is_steady: false,
            columns: Columns::All,
            again: false,
            page: true,
        }
    }
}

impl Options {
    /// The filter.
    pub fn filter(&self) -> Filter {
        if self.is_steady {
            Filter::Steady
        } else {
            Filter::Aekf
        }
    }

    /// The same with filter and columns by their names on the command line.
    ///
    /// # Errors
    /// [`ArchiveError::Refused`] for a name that is not known.
    pub fn named(self, filter: &str, columns: &str) -> Result<Self, ArchiveError> {
        let unknown = |option, found, allowed| {
            ArchiveError::refused(option, format!("found {found:?}, allowed: {allowed}"))
        };
        let is_steady = match filter {
            "aekf" => false,
            "steady" => true,
            found => return Err(unknown("filter", found, "\"aekf\", \"steady\"")),
        };
        let columns = match columns {
            "all" => Columns::All,
            "loads" => Columns::Loads,
            found => return Err(unknown("columns", found, "\"all\", \"loads\"")),
        };
        Ok(Self {
            is_steady,
            columns,
            ..self
        })
    }
}
