//! Bus logs of the same traffic in every format that python-can writes and can-utils print:
//! `loadtwin prove` gives the same result. A damaged BLF log is no proof.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use loadtwin::can::Model;
use loadtwin::can::frame_comparison::Verdict;
use loadtwin::can::live_display::Quiet;
use loadtwin::can::log::LogWriter;
use loadtwin::can::twin_and_prove::{self, ProveArgs, TwinSummary};

use crate::machine::{image, samples, traffic};
use crate::python;

fn proved(model: &Model<'_>, log: &Path) -> TwinSummary {
    let args = ProveArgs {
        log: log.display().to_string(),
        interface: None,
    };
    twin_and_prove::prove(model, &args, &mut Quiet, &AtomicBool::new(false))
        .unwrap_or_else(|error| panic!("{}: {error}", log.display()))
}

/// Writes the log in every format by python-can.
fn converted(log: &Path, folder: &Path) -> Vec<PathBuf> {
    python::output("can_peer.py", &[log.as_os_str(), folder.as_os_str()]);
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries
        .map(|entry| entry.expect("an entry").path())
        .collect()
}

#[test]
fn every_format_of_the_same_traffic_gives_the_same_proof() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    for (is_fd, formats) in [(false, 11), (true, 9)] {
        let folder = tempfile::tempdir().expect("a folder");
        let log = folder.path().join("bus.log");
        let mut writer = LogWriter::create(&log, "can0").expect("created");
        for mut received in traffic(&model, &samples(700, |tick| tick % 177 == 30), is_fd) {
            received.t_us += 1_714_730_400_000_000;
            writer.write(&received).expect("written");
        }
        writer.finish().expect("written");
        let expected = proved(&model, &log).figures;
        assert!(expected.compared_frames > 1000 && expected.missing_ticks > 0);
        let others = folder.path().join("others");
        std::fs::create_dir(&others).expect("a folder");
        let others = converted(&log, &others);
        assert_eq!(others.len(), formats, "{others:?}");
        for path in others {
            let summary = proved(&model, &path);
            let name = path.display();
            assert_eq!(summary.verdict, Verdict::Identical, "{name}");
            assert_eq!(summary.malformed_lines, 0, "{name}");
            let found = summary.figures;
            assert_eq!(found.samples, expected.samples, "{name}");
            assert_eq!(found.compared_bits, expected.compared_bits, "{name}");
            assert_eq!(found.differing_bits, 0, "{name}");
            assert_eq!(found.missing_ticks, expected.missing_ticks, "{name}");
            assert_eq!(found.foreign_frames, expected.foreign_frames, "{name}");
        }
    }
}

/// A BLF log that is cut off or damaged in one container: the others are compared, and it is no proof.
#[test]
fn a_damaged_binary_log_is_incomplete() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("bus.log");
    let mut writer = LogWriter::create(&log, "can0").expect("created");
    for received in traffic(&model, &samples(3000, |_| false), false) {
        writer.write(&received).expect("written");
    }
    writer.finish().expect("written");
    let others = folder.path().join("others");
    std::fs::create_dir(&others).expect("a folder");
    let others = converted(&log, &others);
    let blf = others.iter().find(|path| path.ends_with("blf"));
    let whole = std::fs::read(blf.expect("a BLF log")).expect("read");
    let containers: Vec<usize> = (0..whole.len() - 4)
        .filter(|at| whole[*at..].starts_with(b"LOBJ"))
        .collect();
    assert!(containers.len() > 2, "{containers:?}");
    let mut bits = whole.clone();
    let middle = usize::midpoint(containers[1], containers[2]);
    bits[middle..middle + 64].fill(0xFF);
    let path = folder.path().join("damaged.blf");
    for (damaged, most) in [
        (&whole[..2 * whole.len() / 3], 2999),
        (&whole[..containers[2]], 2999),
        (&bits[..], 2999),
    ] {
        std::fs::write(&path, damaged).expect("written");
        let summary = proved(&model, &path);
        assert_eq!(summary.verdict, Verdict::Incomplete);
        // The container, and a frame that reaches from it into the next.
        assert!((1..=2).contains(&summary.malformed_lines));
        let samples = summary.figures.samples;
        assert!((1000..=most).contains(&samples), "{samples}");
    }
}
