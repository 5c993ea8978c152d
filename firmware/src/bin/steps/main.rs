//! Measures on the emulated Cortex-M4F how many instructions a step takes: each filter, a
//! Butterworth low-pass, the whole estimator of each kind of machine, load counting, and other
//! Kalman filters.
//!
//! Prints `name instructions`, one line each: the mean over 1000 steps with
//! the harness subtracted. Exact and repeatable under
//! `qemu-system-arm -icount shift=10`, where one instruction takes 1024 ns of
//! the time that the board's 25 MHz timer counts:
//!
//! ```sh
//! loadtwin build examples/gearbox/calibrated.toml -o line.image
//! loadtwin build examples/gearbox/calibrated.toml --filter steady -o steady.image
//! loadtwin build examples/rotor/machine.toml -o rotor.image
//! loadtwin build rotor-with-walks.toml -o walking.image
//! loadtwin build rotor-with-drifts.toml -o biased.image
//! loadtwin build tests/machines/cogging-drive.toml -o drive.image
//! loadtwin build examples/bearing/calibrated.toml -o bearing.image
//! LOADTWIN_IMAGE=$PWD/line.image LOADTWIN_STEADY_IMAGE=$PWD/steady.image \
//!     LOADTWIN_ROTOR_IMAGE=$PWD/rotor.image LOADTWIN_WALKING_ROTOR_IMAGE=$PWD/walking.image \
//!     LOADTWIN_BIASED_ROTOR_IMAGE=$PWD/biased.image \
//!     LOADTWIN_BEARING_IMAGE=$PWD/bearing.image \
//!     LOADTWIN_DRIVE_IMAGE=$PWD/drive.image \
//!     LOADTWIN_BEARING_SAMPLES=$PWD/samples cargo build --profile firmware \
//!     --target thumbv7em-none-eabihf -p loadtwin-firmware --features peers --bin steps
//! qemu-system-arm -M mps2-an386 -cpu cortex-m4 -display none -monitor none -icount shift=10 \
//!     -semihosting-config enable=on,target=native \
//!     -kernel target/thumbv7em-none-eabihf/firmware/steps
//! ```
//!
//! `samples`: more than 1000 samples of the bearing, postcard, one after the other; the last
//! 1000 are counted.
//!
//! The innovations are computed within the step; `unscented` contains eleven
//! times `unscented_observation`.
#![no_std]
#![no_main]
#![allow(unsafe_code, reason = "the heap of a peer")]

extern crate alloc;

mod counting;
mod peers;
mod timing;

use alloc::vec::Vec;
use core::hint::black_box;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use embedded_alloc::LlffHeap as Heap;
use loadtwin_common::drivetrain::{GearboxModel, Role};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::frame::FrameEncoder;
use loadtwin_common::io::raw::{MAX_CHANNELS, RawSample};
use loadtwin_common::io::signed_image;
use loadtwin_common::kalman::gaussian::Gaussian;
use loadtwin_common::kalman::innovation::Gate;
use loadtwin_common::kalman::scheduled_gain::{GainBin, GainSchedule};
use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use loadtwin_common::kalman::unscented::Unscented;
use loadtwin_common::kalman::{predict, predict_constant, update};
use loadtwin_common::rotor::MAX_STATES;
use loadtwin_common::rotor::filter;
use loadtwin_common::rotor::filter::{
    BIASES, FORCES, LoadTransition, ObservationRow, StateEstimate, predict_covariance,
    predict_state,
};
use loadtwin_common::rotor::fixed_lag_smoother::{FixedLagSmoother, Gain, LaggedState};
use loadtwin_common::signal::butterworth::{Butterworth, ButterworthState};
use loadtwin_common::signal::phase::Phase;
use nalgebra::{RowSVector, SMatrix, SVector};

use peers::{minikalman, naive};
use timing::{STEPS, report, start_timer, timer};

#[global_allocator]
static HEAP: Heap = Heap::empty();

/// For a peer's builder and the bearing's samples [bytes].
const HEAP_LEN: usize = 1024 * 1024;

/// A stable system of `NX` states, two of them loads, that couples everything.
fn system<const NX: usize>() -> SMatrix<f32, NX, NX> {
    SMatrix::from_fn(|i, j| match (i, j) {
        _ if i == j => {
            if i < NX - 2 {
                0.9
            } else {
                1.0
            }
        }
        _ if i < NX - 2 => 0.02 / (1.0 + i.abs_diff(j) as f32),
        _ => 0.0,
    })
}

/// Channel `i` sees every state.
fn channel<const NX: usize>(i: usize) -> RowSVector<f32, NX> {
    RowSVector::from_fn(|_, j| 1.0 / (1.0 + (i + 2 * j) as f32) + if i == j { 1.0 } else { 0.0 })
}

/// Sixteen samples of the channels, between -1 and 1.
fn samples<const NY: usize>() -> [[f32; NY]; 16] {
    core::array::from_fn(|k| {
        core::array::from_fn(|i| ((k * 37 + i * 101) % 64) as f32 / 32.0 - 1.0)
    })
}

fn kalman<const NX: usize, const NY: usize>(name: &str) {
    let transition = Transition::<NX, 2>::try_new(&system::<NX>(), RandomWalk).unwrap();
    let noise = ProcessNoise::independent(&SVector::repeat(1e-3)).unwrap();
    let rows: [RowSVector<f32, NX>; NY] = core::array::from_fn(channel);
    let (transition, noise, rows, samples) = black_box((transition, noise, rows, samples::<NY>()));
    let mut posterior = Gaussian::independent(SVector::zeros(), &SVector::repeat(1.0)).unwrap();
    let mut gates = [Gate::try_new(1e6, 10).unwrap(); NY];
    report(name, |k| {
        let y = &samples[k as usize % 16];
        predict(&mut posterior, &transition, &noise);
        let mut nis = 0.0;
        for i in 0..NY {
            let nu = y[i] - (rows[i] * posterior.state)[0];
            nis += update(&mut posterior, &rows[i], nu, 0.01, &mut gates[i]).nis;
        }
        black_box(nis);
    });
    black_box(posterior);
}

/// Five states that stay what they are, eight channels quadratic in them.
fn unscented() {
    let rows: [RowSVector<f32, 5>; 8] = core::array::from_fn(channel);
    let noise = ProcessNoise::independent(&SVector::repeat(1e-3)).unwrap();
    let (rows, noise, samples) = black_box((rows, noise, samples::<8>()));
    let r = black_box(SVector::repeat(0.01));
    let filter = black_box(Unscented::default());
    let mut posterior = Gaussian::independent(SVector::zeros(), &SVector::repeat(1.0)).unwrap();
    let mut gates = [Gate::try_new(1e6, 10).unwrap(); 8];
    let observe = |x: &SVector<f32, 5>| {
        SVector::<f32, 8>::from_fn(|i, _| {
            let linear = (rows[i] * x)[0];
            linear + 0.1 * linear * linear
        })
    };
    report("unscented_observation_5_8", |_| {
        black_box(observe(black_box(&posterior.state)));
    });
    report("unscented_5_8", |k| {
        predict_constant(&mut posterior, &noise);
        let y = SVector::from(samples[k as usize % 16]);
        let result = filter
            .update(&mut posterior, observe, &y, &r, &mut gates)
            .unwrap();
        black_box(result[7].nis);
    });
    black_box(posterior);
}

/// Six states, four channels, 64 gains over the angle.
// Inlined, its table would be on the stack below that of the estimator.
#[inline(never)]
fn scheduled_gain() {
    let transition = Transition::<6, 2>::try_new(&system::<6>(), RandomWalk).unwrap();
    let rows: [RowSVector<f32, 6>; 4] = core::array::from_fn(channel);
    let bins: [GainBin<6, 4, 2>; 64] = core::array::from_fn(|bin| GainBin {
        gain: SMatrix::repeat(0.001 * bin as f32),
        load_variances: SVector::repeat(1.0 + bin as f32),
    });
    let (transition, rows, bins, samples) = black_box((transition, rows, bins, samples::<4>()));
    let schedule = black_box(GainSchedule::try_new(&bins).unwrap());
    let mut state = SVector::zeros();
    report("scheduled_gain_6_4", |k| {
        let y = &samples[k as usize % 16];
        state = transition.propagate(&state);
        let nu = SVector::<f32, 4>::from_fn(|i, _| y[i] - (rows[i] * state)[0]);
        if let Some(place) = schedule.at(0.05 * k as f32) {
            black_box(place.correct(&mut state, &nu));
            black_box(place.load_variances());
        }
    });
    black_box(state);
}

fn butterworth() {
    let filter = black_box(Butterworth::try_new(10.0, 0.001).unwrap());
    let mut state = ButterworthState::default();
    report("butterworth", |k| {
        black_box(filter.step(&mut state, k as f32));
    });
}

/// Samples of a turn: 29 turns a minute at 500 samples a second and 16384 counts a turn.
const TURN: usize = 1024;

/// What the four gauges of the gearbox read over a turn at half the nominal load,
/// with noise of half a micrometre a metre.
fn words(model: &GearboxModel<'_>) -> Vec<[i32; 4]> {
    let pulse = model.index.as_ref().unwrap().angle;
    let words = (0..TURN).map(|k| {
        let angle = pulse.wrapping_add(Phase(((k as u64) << 32) / TURN as u64 * (1 << 32)));
        core::array::from_fn(|i| {
            let channel = &model.channels[i];
            let Role::Measure { offset, map, .. } = &channel.role else {
                return 0;
            };
            let reading = offset + 0.5 * map.at(angle).0;
            let noise = ((k * 37 + i * 101) % 64) as i32 - 32;
            channel.converter.zero + (reading / channel.converter.gain) as i32 + 16 * noise
        })
    });
    words.collect()
}

/// The whole estimator of a gearbox, raw words to payload bytes, on a sealed image.
// Inlined, two of them would be on the stack at once.
#[inline(never)]
fn line(name: &str, sealed: &[u8]) {
    let (_, payload) = signed_image::open(sealed).unwrap();
    let image = Image::from_bytes(payload).unwrap();
    let Model::Gearbox(model) = &image.model else {
        panic!("not the image of a gearbox");
    };
    let words = words(model);
    let encoder = FrameEncoder::try_build(&image, 0).unwrap();
    let mut line = Estimator::try_build(image).unwrap();
    let mut steady = 0;
    let mut sample = |tick: u32| {
        let mut raw = RawSample {
            tick,
            ..RawSample::default()
        };
        for (i, word) in words[tick as usize % TURN].iter().enumerate() {
            raw.set_word(i, *word);
        }
        raw.set_encoder(0, tick * 16);
        raw.index = (tick as usize).is_multiple_of(TURN).then_some(tick * 16);
        let mut estimate = Estimate::default();
        line.step_into(black_box(&raw), &mut estimate);
        steady += u32::from(estimate.steady);
        encoder.estimate(&estimate, |frame| {
            black_box(frame);
        });
    };
    (0..3000).for_each(&mut sample);
    report(name, |k| sample(3000 + k));
    hprintln!("{}_by_steady_gains {}", name, steady);
}

/// The filter of a rotor alone: 8 modal displacements that everything couples with, two
/// loads that turn, 4 sensors, each with a bias where there are states for it; by the full
/// recursion, by a gain, and with the two samples before corrected as well.
#[inline(never)]
fn rotor_filter<const NX: usize>([full, scheduled, lagging]: [&str; 3]) {
    const NZ: usize = 8;
    let dense: [[f32; NX]; NZ] = core::array::from_fn(|i| {
        core::array::from_fn(|j| match j {
            _ if j == i => -0.05,
            _ if j == NZ + i => -0.1,
            _ => 1e-3,
        })
    });
    let rows: [ObservationRow<f32, NZ>; 4] = core::array::from_fn(|i| ObservationRow {
        modal: core::array::from_fn(|j| 1.0 / (1.0 + (i + 2 * j) as f32)),
        bias: (NX > 2 * NZ + FORCES).then_some(2 * NZ + FORCES + i),
    });
    let gain: Gain<NX> = [[1e-3; NX]; MAX_CHANNELS];
    let turn = LoadTransition {
        synchronous_mask: 3,
        pairs: 2,
        cos_minus_one: -0.001,
        sin: 0.044,
        bias_decay: [0.999; BIASES],
    };
    let noise = [1e-6_f32; MAX_STATES * (MAX_STATES + 1) / 2];
    let (dense, rows, gain, turn, samples) = black_box((dense, rows, gain, turn, samples::<4>()));
    let mut posterior = StateEstimate {
        state: [0.0; NX],
        covariance: core::array::from_fn(|i| core::array::from_fn(|j| f32::from(u8::from(i == j)))),
    };
    report(full, |k| {
        predict_state(&mut posterior.state, &dense, &turn);
        predict_covariance(&mut posterior.covariance, &dense, &turn, |i| noise[i]);
        for (row, y) in rows.iter().zip(&samples[k as usize % 16]) {
            black_box(filter::update(&mut posterior, row, *y, 0.01, |nis| {
                nis < 1e6
            }));
        }
    });
    let by_gain = |posterior: &mut StateEstimate<f32, NX>, k: u32| {
        predict_state(&mut posterior.state, &dense, &turn);
        let y = &samples[k as usize % 16];
        let nu: [f32; 4] = core::array::from_fn(|i| {
            y[i] - filter::predict_measurement(&posterior.state, &rows[i])
        });
        for (gain, nu) in gain.iter().zip(nu) {
            for j in 0..NX {
                posterior.state[j] += gain[j] * nu;
            }
        }
        nu
    };
    report(scheduled, |k| {
        by_gain(&mut posterior, k);
    });
    let mut past = FixedLagSmoother::new(LaggedState::diffuse(0.0));
    let before = black_box([gain; 2]);
    report(lagging, |k| {
        past.advance().capture::<NZ>(&posterior, 0.0);
        let nu = by_gain(&mut posterior, k);
        past.update(&before, &nu);
        black_box(past.lagged(2));
    });
    black_box(posterior);
}

/// The whole estimator of a rotor, raw words to estimate: 4 sensors at rest but for noise; by the
/// full recursion throughout, or after it has converged.
#[inline(never)]
fn rotor_line(name: &str, sealed: &[u8], full: bool) {
    let (_, payload) = signed_image::open(sealed).unwrap();
    let mut image = Image::from_bytes(payload).unwrap();
    let Model::Rotor(model) = &mut image.model else {
        panic!("not the image of a rotor");
    };
    let described = model.levels.first_mut().unwrap();
    let settled = if full { 100 } else { described.full_samples };
    if full {
        described.full_samples = u32::MAX;
    }
    let sensors = model.channels.len();
    let mut line = Estimator::try_build(image).unwrap();
    let mut steady = 0;
    let mut sample = |tick: u32| {
        let mut raw = RawSample {
            tick,
            ..RawSample::default()
        };
        for i in 0..sensors {
            raw.set_word(i, (tick as usize * 37 + i * 101) as i32 % 64 - 32);
        }
        let mut estimate = Estimate::default();
        line.step_into(black_box(&raw), &mut estimate);
        steady += u32::from(black_box(&estimate).steady);
    };
    (0..=settled).for_each(&mut sample);
    report(name, |k| sample(settled + 1 + k));
    hprintln!("{}_by_steady_gains {}", name, steady);
}

/// The whole estimator of a bearing, raw words to estimate: the mean, and the most that one sample
/// takes, for the work on a block is spread over the samples of the next one.
#[inline(never)]
fn bearing_line(sealed: &[u8], mut recorded: &[u8]) {
    let mut samples: Vec<RawSample> = Vec::new();
    while let Ok((sample, rest)) = postcard::take_from_bytes(recorded) {
        samples.push(sample);
        recorded = rest;
    }
    let (settled, measured) = samples.split_at(samples.len() - STEPS as usize);
    let (_, payload) = signed_image::open(sealed).unwrap();
    let mut line = Estimator::try_build(Image::from_bytes(payload).unwrap()).unwrap();
    for raw in settled {
        line.step(raw);
    }
    let mut same = line.clone();
    let mut valid = 0;
    report("bearing_line", |k| {
        let mut estimate = Estimate::default();
        line.step_into(black_box(&measured[k as usize]), &mut estimate);
        valid += u32::from(estimate.loads.iter().all(|load| load.fault.is_none()));
    });
    let most = (measured.iter())
        .map(|raw| {
            let before = timer();
            let mut estimate = Estimate::default();
            same.step_into(black_box(raw), &mut estimate);
            black_box(&estimate);
            before - timer()
        })
        .max();
    hprintln!("bearing_line_most {}", most.unwrap_or(0) * 10 / 256);
    hprintln!("bearing_line_valid {}", valid);
}

/// The whole estimator of a drive that swings: its position and all of its channels in every
/// sample.
#[inline(never)]
fn drive_line(sealed: &[u8]) {
    let (_, payload) = signed_image::open(sealed).unwrap();
    let mut line = Estimator::try_build(Image::from_bytes(payload).unwrap()).unwrap();
    let mut sample = |tick: u32| {
        let mut raw = RawSample {
            tick,
            ..RawSample::default()
        };
        let back = tick % 2000;
        let place = if back < 1000 { back } else { 2000 - back };
        raw.set_encoder(0, place * 7);
        for i in 0..2 {
            raw.set_word(i, (tick as usize * 37 + i * 101) as i32 % 4096 - 2048);
        }
        let mut estimate = Estimate::default();
        line.step_into(black_box(&raw), &mut estimate);
        black_box(&estimate);
    };
    (0..STEPS).for_each(&mut sample);
    report("drive_line", |k| sample(STEPS + k));
}

#[entry]
fn main() -> ! {
    static mut ROOM: [MaybeUninit<u8>; HEAP_LEN] = [MaybeUninit::uninit(); HEAP_LEN];
    // SAFETY: the heap is set up once, before anything is allocated, and owns the memory.
    unsafe { HEAP.init(ROOM.as_mut_ptr() as usize, HEAP_LEN) };
    start_timer();
    kalman::<6, 4>("kalman_6_4");
    kalman::<6, 1>("kalman_6_1");
    kalman::<12, 4>("kalman_12_4");
    unscented();
    scheduled_gain();
    butterworth();
    counting::counting();
    line("gearbox_line", include_bytes!(env!("LOADTWIN_IMAGE")));
    line(
        "gearbox_steady_line",
        include_bytes!(env!("LOADTWIN_STEADY_IMAGE")),
    );
    rotor_filter::<20>(["rotor_20_4", "rotor_scheduled_gain_20_4", "rotor_lag_20_4"]);
    rotor_filter::<24>(["rotor_24_4", "rotor_scheduled_gain_24_4", "rotor_lag_24_4"]);
    let rotor = include_bytes!(env!("LOADTWIN_ROTOR_IMAGE"));
    rotor_line("rotor_line", rotor, true);
    rotor_line("rotor_steady_line", rotor, false);
    let rotor = include_bytes!(env!("LOADTWIN_WALKING_ROTOR_IMAGE"));
    rotor_line("walking_rotor_steady_line", rotor, false);
    let rotor = include_bytes!(env!("LOADTWIN_BIASED_ROTOR_IMAGE"));
    rotor_line("biased_rotor_line", rotor, true);
    rotor_line("biased_rotor_steady_line", rotor, false);
    bearing_line(
        include_bytes!(env!("LOADTWIN_BEARING_IMAGE")),
        include_bytes!(env!("LOADTWIN_BEARING_SAMPLES")),
    );
    drive_line(include_bytes!(env!("LOADTWIN_DRIVE_IMAGE")));
    minikalman::<6, 4>("minikalman_6_4");
    minikalman::<6, 1>("minikalman_6_1");
    minikalman::<12, 4>("minikalman_12_4");
    naive::<6, 4>("naive_nalgebra_6_4");
    naive::<6, 1>("naive_nalgebra_6_1");
    naive::<12, 4>("naive_nalgebra_12_4");
    debug::exit(debug::EXIT_SUCCESS);
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    loop {
        cortex_m::asm::wfi();
    }
}
