//! Writes the tables of a rotor on two bearings into a draft description: shaft, disc and bearings,
//! marked to be filled in; displacement sensors, forces, encoder and index pulse from the columns
//! of the recording.

use std::f64::consts::TAU;

use loadtwin_machine::MOST_LOADS;

use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::sensor_tables::{channel, references};
use super::toml_text::{Text, number, rounded_up};
use super::{InitError, Source};

/// Elements of the shaft until its own are filled in.
const ELEMENTS: usize = 20;

/// Samples a turn at the speed that holds the place of the rotor's own.
const SAMPLES_PER_TURN: f64 = 20.0;

/// Largest speed that holds the place of the rotor's own (rad/s).
const SPEED_RAD_S: f64 = 100.0;

impl Source<'_> {
    pub(super) fn rotor(&self, text: &mut Text) -> Result<(), InitError> {
        let sensors = self.of_kind(&[ColumnKind::Length]);
        if sensors.is_empty() {
            return Err(self.refused("a rotor has displacements (m, mm, µm)"));
        }
        let forces = self.of_kind(&[ColumnKind::Force]);
        let encoders = self.of_kind(&[ColumnKind::Counts, ColumnKind::Angle, ColumnKind::Speed]);
        let encoders = &encoders[..encoders.len().min(1)];
        text.table("[rotor]");
        let speed = encoders
            .iter()
            .find(|column| column.kind == ColumnKind::Speed);
        let speed = speed.map(|column| column.unit.to_si(column.largest()).abs());
        let slow = (TAU * self.rate_hz() / SAMPLES_PER_TURN).min(SPEED_RAD_S);
        text.fill_in(
            "speed_rad_s",
            rounded_up(speed.filter(|speed| *speed > 0.0).unwrap_or(slow)),
            "the speed (rad/s)",
        );
        shaft(text);
        let pairs = forces.len().div_ceil(2).clamp(1, MOST_LOADS);
        for load in 0..pairs {
            text.table("[[rotor.load]]");
            text.set(
                "names",
                format_args!("[\"load{0}_x\", \"load{0}_y\"]", load + 1),
            );
            let node = (load + 1) * ELEMENTS / (pairs + 1);
            text.fill_in("node", node, "the node that the force acts on");
            let size = forces
                .get(2 * load)
                .map_or(1.0, |column| column.unit.to_si(column.largest()));
            text.fill_in(
                "nominal_n",
                rounded_up(size),
                "the size of the force at that speed (N)",
            );
        }
        let mut at = Places::default();
        for sensor in &sensors {
            let (node, direction) = at.of(sensor, sensors.len());
            let senses =
                format!("{{ displacement = {{ node = {node}, direction_deg = {direction} }} }}");
            channel(
                text,
                sensor,
                (&senses, Some("node and direction of the sensor")),
                None,
            );
        }
        for encoder in encoders {
            self.encoder(text, encoder, None);
        }
        self.index(text, encoders);
        let names = ["load1_x", "load1_y", "load2_x", "load2_y"];
        references(text, &forces[..forces.len().min(2 * MOST_LOADS)], &names);
        self.auxiliaries(text);
        Ok(())
    }
}

/// Directions of the sensors by their names, x and y in turn where these do not say.
#[derive(Default)]
struct Places {
    before: usize,
}

impl Places {
    fn of(&mut self, sensor: &ClassifiedColumn, count: usize) -> (usize, u32) {
        let name = sensor.name.to_lowercase();
        let has = |letter: char| {
            let place = name.find(letter);
            place.is_some_and(|at| {
                let apart = |c: Option<char>| c.is_none_or(|c| !c.is_alphabetic());
                apart(name[..at].chars().last()) && apart(name[at + 1..].chars().next())
            })
        };
        let direction = match (has('x'), has('y')) {
            (true, false) => 0,
            (false, true) => 90,
            _ => 90 * (self.before % 2) as u32,
        };
        let pair = self.before / 2;
        self.before += 1;
        let node = (pair + 1) * ELEMENTS / (count.div_ceil(2) + 1);
        (node.clamp(1, ELEMENTS - 1), direction)
    }
}

fn shaft(text: &mut Text) {
    text.table("[[rotor.material]]");
    text.set("name", "\"steel\"");
    text.set("young_pa", "2.1e11");
    text.set("density_kg_per_m3", "7850");
    text.set("poisson", "0.29");
    text.table("[[rotor.section]]");
    text.fill_in(
        "length_m",
        "1",
        "the sections of the shaft from left to right: length (m)",
    );
    text.fill_in(
        "elements",
        number(ELEMENTS as f64),
        "elements that it is divided into; nodes count from 0",
    );
    text.fill_in("outer_m", "0.02", "the outer diameter (m)");
    text.table("[[rotor.disc]]");
    text.fill_in("node", ELEMENTS / 2, "the discs: node");
    text.fill_in("mass_kg", "1", "mass (kg)");
    text.fill_in(
        "polar_kg_m2",
        "0.002",
        "moment of inertia about the shaft (kg m2)",
    );
    text.fill_in(
        "diametral_kg_m2",
        "0.001",
        "moment of inertia about a diameter (kg m2)",
    );
    for node in [1, ELEMENTS - 1] {
        text.table("[[rotor.bearing]]");
        text.fill_in("node", node, "the node of the bearing");
        text.fill_in(
            "stiffness_n_per_m",
            "[[1e7, 0], [0, 1e7]]",
            "its stiffness over x and y (N/m)",
        );
        text.fill_in(
            "damping_n_s_per_m",
            "[[100, 0], [0, 100]]",
            "its damping over x and y (N s/m)",
        );
    }
}
