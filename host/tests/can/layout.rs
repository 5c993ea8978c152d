//! Compares the bit positions in `common/src/io/frame/signal_layout.rs`, and the faults, states and
//! refusals of the code, with the DBC; `LOADTWIN_BLESS=1` writes `signal_layout.rs` anew.

use std::collections::BTreeMap;
use std::fmt::Write;

use can_dbc::{Dbc, MessageId, MultiplexIndicator, ValueType};
use loadtwin::can::dbc::DBC;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::frame::{DEFAULT_BASE, IDS_PER_MACHINE, State};
use loadtwin_common::io::signed_image::ImageError;

fn dbc() -> Dbc {
    Dbc::try_from(DBC).expect("the DBC parses")
}

fn id(id: MessageId) -> u16 {
    match id {
        MessageId::Standard(id) => id,
        MessageId::Extended(id) => panic!("extended identifier {id}"),
    }
}

fn snake(name: &str) -> String {
    let mut out = String::new();
    let mut before = 'A';
    for c in name.chars() {
        if c.is_ascii_uppercase() && !before.is_ascii_uppercase() {
            out.push('_');
        }
        out.push(c.to_ascii_lowercase());
        before = c;
    }
    out
}

/// Constants for each message; messages that differ in their number only
/// share one set, and so do signals of one name on several pages.
fn generate(dbc: &Dbc) -> String {
    let mut out = "//! Bit positions of the CAN signals. Generated from `docs/loadtwin.dbc`; a test of `loadtwin` compares\n\
        //! both and, with `LOADTWIN_BLESS=1`, writes this file anew.\n"
        .to_owned();
    let mut shapes = BTreeMap::new();
    for message in &dbc.messages {
        let group = message.name.trim_end_matches(|c: char| c.is_ascii_digit());
        let shape: Vec<_> = message
            .signals
            .iter()
            .map(|s| (s.start_bit, s.size, s.value_type))
            .collect();
        if let Some(first) = shapes.get(group) {
            assert_eq!(
                *first, shape,
                "{} is not like the first of its kind",
                message.name
            );
            continue;
        }
        shapes.insert(group, shape);
        let offset = id(message.id) - DEFAULT_BASE;
        assert!(offset < IDS_PER_MACHINE);
        let _ = write!(
            out,
            "\n/// `{}`.\npub mod {} {{\n    use crate::io::frame::Field;\n\n    \
             /// Identifier, from the base.\n    pub const OFFSET: u16 = {offset};\n",
            message.name,
            snake(group)
        );
        let mut fields = BTreeMap::new();
        for signal in &message.signals {
            let mut name = signal.name.clone();
            if matches!(
                signal.multiplexer_indicator,
                MultiplexIndicator::MultiplexedSignal(_)
            ) {
                name.retain(|c| !c.is_ascii_digit());
            }
            let name = name.strip_prefix(&message.name).unwrap_or(&name).to_owned();
            let place = (signal.start_bit, signal.size, signal.value_type);
            if let Some(first) = fields.insert(name.clone(), place) {
                assert_eq!(first, place, "{name} lies elsewhere on another page");
                continue;
            }
            let kind = if signal.value_type == ValueType::Signed {
                "signed"
            } else {
                "unsigned"
            };
            let _ = write!(
                out,
                "    /// Signal `{name}`.\n    pub const {}: Field = Field::{kind}({}, {});\n",
                snake(&name).to_uppercase(),
                signal.start_bit,
                signal.size
            );
        }
        out.push_str("}\n");
    }
    out
}

#[test]
fn the_constants_are_those_of_the_dbc() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../common/src/io/frame/signal_layout.rs"
    );
    let generated = generate(&dbc());
    if std::env::var_os("LOADTWIN_BLESS").is_some() {
        std::fs::write(path, &generated).expect("written");
    }
    let present = std::fs::read_to_string(path).expect("the constants");
    assert_eq!(present, generated, "run again with LOADTWIN_BLESS=1");
}

/// The value table of a signal.
fn table(dbc: &Dbc, message: u16, signal: &str) -> BTreeMap<i64, String> {
    let found = dbc
        .value_descriptions
        .iter()
        .find_map(|description| match description {
            can_dbc::ValueDescription::Signal {
                message_id,
                name,
                value_descriptions,
            } if id(*message_id) == message && name == signal => Some(value_descriptions),
            _ => None,
        });
    found
        .unwrap_or_else(|| panic!("no table for {signal}"))
        .iter()
        .map(|value| (value.id, value.description.clone()))
        .collect()
}

#[test]
fn the_tables_name_every_fault_state_and_refusal() {
    let dbc = dbc();
    let faults: BTreeMap<i64, String> = Fault::ALL
        .iter()
        .map(|f| (i64::from(*f as u8), f.name().replace('_', " ")))
        .collect();
    for load in 1..=6 {
        assert_eq!(
            table(&dbc, DEFAULT_BASE + load, &format!("Load{load}Fault")),
            faults
        );
    }
    for sensor in 0..10 {
        assert_eq!(
            table(&dbc, DEFAULT_BASE + 7, &format!("Sensor{sensor}Fault")),
            faults
        );
    }
    let states = State::ALL
        .iter()
        .map(|s| (i64::from(*s as u8), s.name().to_owned()))
        .collect();
    assert_eq!(table(&dbc, DEFAULT_BASE, "State"), states);
    let refused = table(&dbc, DEFAULT_BASE, "Refused");
    assert_eq!(refused.len(), 1 + ImageError::ALL.len());
    for refusal in ImageError::ALL {
        assert!(
            refused.contains_key(&i64::from(refusal.code())),
            "{refusal:?}"
        );
    }
}
