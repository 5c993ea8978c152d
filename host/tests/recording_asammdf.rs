//! Exchange of MDF4 files with asammdf in both directions.

#[path = "reference/python.rs"]
mod python;

use std::path::Path;

use loadtwin::recording::{CsvLayout, OutputColumn, Problem, Reader, Wanted, Writer};

/// Output of the peer script.
fn asammdf(action: &str, path: &Path) -> Vec<u8> {
    python::output("asammdf_peer.py", &[action.as_ref(), path.as_os_str()])
}

/// The same numbers but for the last bit, which the JSON in between may lose.
fn assert_same(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let same = (f - e).abs() <= f64::EPSILON * e.abs();
        assert!(same || e.is_nan(), "row {i}: {f} for {e}");
    }
}

fn wanted<'a>(name: &'a str, unit: &str) -> Wanted<'a> {
    Wanted {
        name,
        unit: unit.parse().unwrap(),
        required: true,
    }
}

#[test]
fn asammdf_reads_what_we_write() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ours.mf4");
    let column = |name: &str, unit: &str, single| OutputColumn {
        name: name.into(),
        unit: unit.parse().unwrap(),
        single,
    };
    let columns = [
        column("torque_main", "Nm", true),
        column("ta1", "µm/m", false),
        column("T", "°C", false),
    ];
    let t: Vec<f64> = (0..5000).map(|i| f64::from(i) / 500.0).collect();
    let torque: Vec<f64> = (0..5000_u16)
        .map(|i| f64::from(f32::from(i) * 0.1))
        .collect();
    let strain: Vec<f64> = (0..5000)
        .map(|i| {
            if i % 100 == 7 {
                f64::NAN
            } else {
                f64::from(i).sin()
            }
        })
        .collect();
    let warm = vec![21.5; 5000];
    let mut writer = Writer::create(&path, &columns, &[("machine", "bench")]).unwrap();
    writer.write(&t, &[&torque, &strain, &warm]).unwrap();
    writer.finish().unwrap();

    let found: serde_json::Value = serde_json::from_slice(&asammdf("read", &path)).unwrap();
    let channels = found["channels"].as_array().unwrap();
    let text = |i: usize, key: &str| channels[i][key].as_str().unwrap().to_string();
    let numbers = |i: usize, key: &str| -> Vec<f64> {
        let values = channels[i][key].as_array().unwrap();
        values.iter().map(|v| v.as_f64().unwrap()).collect()
    };
    assert_eq!(channels.len(), 3);
    for (i, (name, unit, kind)) in [
        ("torque_main", "Nm", "float32"),
        ("ta1", "µm/m", "float64"),
        ("T", "°C", "float64"),
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(text(i, "name"), name);
        assert_eq!(text(i, "unit"), unit);
        assert_eq!(text(i, "kind"), kind);
        assert_same(&numbers(i, "t"), &t);
    }
    assert_same(&numbers(0, "values"), &torque);
    assert_same(&numbers(1, "values"), &strain);
    assert_same(&numbers(2, "values"), &warm);
    let missing: Vec<f64> = (0..5000).filter(|i| i % 100 == 7).map(f64::from).collect();
    assert_eq!(numbers(1, "invalid"), missing);
}

#[test]
fn we_read_what_asammdf_writes() {
    const ROWS: usize = 20_000;
    let dir = tempfile::tempdir().unwrap();
    asammdf("write", dir.path());
    let mut files = 0;
    for entry in std::fs::read_dir(dir.path()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.display();
        let want = [
            wanted("torque", "Nm"),
            wanted("ta1", "µm/m"),
            wanted("index", "counts"),
            wanted("enc", "counts"),
        ];
        let reader = Reader::open(&path, &CsvLayout::default(), &want).unwrap();
        assert!((reader.period_s() - 0.002).abs() < 1e-9, "{name}");
        let mut i = 0;
        for block in reader {
            let block = block.unwrap_or_else(|e| panic!("{e}"));
            for k in 0..block.len() {
                let value = |c: usize| block.columns[c].as_ref().unwrap()[k];
                assert_eq!(block.t[k], i as f64 / 500.0, "{name} row {i}");
                let torque = f64::from((i as f64 * 1e-3) as f32) * 1e3;
                if i % 100 == 7 {
                    assert!(value(0).is_nan(), "{name} row {i}: {}", value(0));
                } else {
                    assert_eq!(value(0), torque, "{name} row {i}");
                }
                assert_eq!(value(1), 0.25 * (i * 31 % 8192) as f64 - 1000.0);
                assert_eq!(value(2), -(i as f64));
                assert_eq!(value(3), (i * 17 % 8192) as f64);
                i += 1;
            }
        }
        assert_eq!(i, ROWS, "{name}");

        // The slow channel alone is a recording too; as a sensor beside the others it is none.
        let slow = [wanted("oil", "°C")];
        let mut reader = Reader::open(&path, &CsvLayout::default(), &slow).unwrap();
        let block = reader.next().unwrap().unwrap();
        assert_eq!((block.len(), reader.period_s()), (40, 1.0), "{name}");
        let both = [
            wanted("ta1", "m/m"),
            wanted("enc", "counts"),
            wanted("oil", "K"),
        ];
        let error = Reader::open(&path, &CsvLayout::default(), &both)
            .err()
            .unwrap();
        assert!(
            matches!(&error.problem, Problem::OtherRate { column, .. } if column == "oil"),
            "{error}"
        );
        // A thermometer may be slower than the sensors.
        let slow = Wanted {
            required: false,
            ..wanted("oil", "°C")
        };
        let mut reader =
            Reader::open(&path, &CsvLayout::default(), &[wanted("ta1", "m/m"), slow]).unwrap();
        let [note] = reader.notes() else {
            panic!("{name}: {:?}", reader.notes());
        };
        assert!(note.contains("is interpolated to 0.002"), "{note}");
        let block = reader.next().unwrap().unwrap();
        let oil = block.columns[1].as_ref().unwrap();
        assert!((oil[250] - 20.5).abs() < 1e-9, "{name}: {}", oil[250]);
        let text = [wanted("note", "1")];
        let line = match Reader::open(&path, &CsvLayout::default(), &text) {
            Ok(_) => panic!("{name}: text read as numbers"),
            Err(e) => e.to_string(),
        };
        assert!(line.contains("`note`"), "{line}");
        files += 1;
    }
    assert_eq!(files, 12);
}
