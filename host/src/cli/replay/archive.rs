//! The command `loadtwin replay --archive DIR`: its options, and the replay of all machines of an
//! archive, day by day, on all cores, by the crate `loadtwin_archive`, with a progress bar. Days
//! that are up to date are left out.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use loadtwin_archive::{Columns, Options, Watch, run};

use crate::cli::printing::say;
use crate::cli::progress::Progress;
use crate::image_build::Filter;

/// Time between two looks at the progress.
const LOOK: Duration = Duration::from_millis(20);

/// What one machine is replayed by, which no option of an archive goes with.
const ONE_MACHINE: [&str; 2] = ["machine", "recording"];

/// Options of a run over an archive.
#[derive(Debug, Args)]
pub(super) struct ArchiveOptions {
    /// Replay the days of all machines of the archive in DIR that are not up to date: its
    /// recordings/machine=NAME/day=YYYY-MM-DD/*.parquet, by its descriptions.csv.
    #[arg(long, value_name = "DIR", conflicts_with_all = [
        "machine", "recording", "baselines", "all_sensors", "estimates", "nodes", "state_in",
        "state_out", "report", "layout",
    ])]
    archive: Option<PathBuf>,
    /// Folder of the results of --archive; results in the archive where absent.
    #[arg(long, short = 'o', value_name = "DIR", conflicts_with_all = ONE_MACHINE)]
    results: Option<PathBuf>,
    /// Columns of the estimates of --archive.
    #[arg(long, value_enum, conflicts_with_all = ONE_MACHINE, default_value = "all")]
    columns: KeptColumns,
    /// Replay all days of --archive again.
    #[arg(long, conflicts_with_all = ONE_MACHINE)]
    again: bool,
    /// Write no pages of --archive.
    #[arg(long, conflicts_with_all = ONE_MACHINE)]
    no_page: bool,
    /// Machines of --archive at once; one for each core where absent.
    #[arg(long, value_name = "N", conflicts_with_all = ONE_MACHINE)]
    processes: Option<usize>,
}

/// Columns of the estimates that are kept.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum KeptColumns {
    /// Loads and innovations of each sensor.
    All,
    /// Loads.
    Loads,
}

impl ArchiveOptions {
    /// Replays the archive, where one is given; false where none is.
    pub(super) fn run(
        &self,
        sensors: Option<&str>,
        filter: Filter,
        as_json: bool,
    ) -> anyhow::Result<bool> {
        let Some(archive) = &self.archive else {
            return Ok(false);
        };
        let beside = || archive.join("results");
        let results = self.results.clone().unwrap_or_else(beside);
        let options = Options {
            sensors: sensors.map(str::to_owned),
            is_steady: filter == Filter::Steady,
            columns: match self.columns {
                KeptColumns::All => Columns::All,
                KeptColumns::Loads => Columns::Loads,
            },
            again: self.again,
            page: !self.no_page,
        };
        let watch = Watch::default();
        let figures = std::thread::scope(|scope| {
            let work = scope.spawn(|| run(archive, &results, &options, self.processes, &watch));
            let progress = Progress::new("replay");
            while !work.is_finished() {
                let (done, total) = watch.progress();
                progress.show(done as f64 / total.max(1) as f64);
                std::thread::sleep(LOOK);
            }
            work.join()
        });
        let figures =
            figures.map_err(|_| anyhow::anyhow!("the replay of the archive gave up"))??;
        if as_json {
            say!("{}", serde_json::to_string(&figures)?);
        } else {
            say!("{figures}");
        }
        Ok(true)
    }
}
