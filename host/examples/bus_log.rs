//! Writes the log of a bus without a bus: raw samples of a recording, and the frames that the
//! machine's estimator sends between them.
//!
//!     cargo run --release -p loadtwin --example bus_log -- MACHINE RECORDING LOG

use std::collections::VecDeque;
use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use loadtwin::build::{self, Sensors};
use loadtwin::can::bus::{Bus, BusError, Received};
use loadtwin::can::log::LogWriter;
use loadtwin::can::node::{self, NodeArgs};
use loadtwin::can::page::Quiet;
use loadtwin::can::send::{self, SendArgs};
use loadtwin::can::{CanError, Model};
use loadtwin::machine::Machine;
use loadtwin::replay::Samples;
use socketcan::CanAnyFrame;

/// Length of a classic frame of 8 bytes at 500 kbit/s, with stuffing.
const FRAME: Duration = Duration::from_micros(250);

/// A bus that one side fills and the other reads, frame after frame.
#[derive(Default)]
struct Memory {
    waiting: VecDeque<CanAnyFrame>,
    carried: Vec<Received>,
    now: Duration,
}

impl Memory {
    fn carry(&mut self, frame: CanAnyFrame) -> Received {
        self.now += FRAME;
        let t_us = self.now.as_micros() as u64;
        let received = Received { t_us, frame };
        self.carried.push(received);
        received
    }
}

impl Bus for &mut Memory {
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Received>, BusError> {
        let frame = self.waiting.pop_front().ok_or(BusError::Ended)?;
        Ok(Some(self.carry(frame)))
    }

    fn send(&mut self, frame: &CanAnyFrame) -> Result<(), BusError> {
        self.carry(*frame);
        Ok(())
    }

    fn restart(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn wait(&mut self, time: Duration) {
        self.now += time;
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [machine, recording, log] = arguments.as_slice() else {
        return Err("usage: bus_log MACHINE RECORDING LOG".into());
    };
    let machine = Machine::load(Path::new(machine))?;
    let sensors = Sensors::choose(&machine, None)?;
    let image = build::image(&machine, &sensors)?;
    let model = Model::from_bytes(&image)?;
    let mut samples = Vec::new();
    let mut reader = Samples::open(&machine, &sensors, Path::new(recording))?;
    while reader.next_block(|sample| samples.push(Ok(sample.raw)))? {}

    let (stop, mut view) = (AtomicBool::new(false), Quiet);
    let interface = "can0".to_owned();
    let sending = SendArgs {
        interface: interface.clone(),
        fast: true,
        fd: false,
        lockstep: None,
    };
    let answering = NodeArgs {
        interface: interface.clone(),
        idle: None,
    };
    let mut raw = Memory::default();
    send::run(&model, &mut raw, samples, &sending, &mut view, &stop)?;
    let mut bus = Memory {
        waiting: raw.carried.iter().map(|received| received.frame).collect(),
        ..Memory::default()
    };
    node::run(&model, &mut bus, &answering, &mut view, &stop)?;
    let mut writer = LogWriter::create(Path::new(log), &interface)?;
    bus.carried
        .iter()
        .try_for_each(|received| writer.write(received))?;
    writer.finish().map_err(CanError::into)
}
