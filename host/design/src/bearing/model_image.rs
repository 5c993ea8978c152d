//! Builds the model image of a wheel bearing from its description and its calibration: contact
//! geometry, gauge responses, wheel encoder, scaling of the loads on the bus, filter tuning. Also
//! reads the calibration file that the description names.

use std::f64::consts::PI;

use faer::{Mat, Side};
use loadtwin_common::bearing::{BearingModel, GAUGES, GaugeModel, LOADS, Tuning};
use loadtwin_common::image::Model;
use loadtwin_common::io::measurement::AdcScaling;
use loadtwin_common::load_signal::LoadSignal;

use crate::bearing::calibration_file::Calibration;
use crate::bearing::physical_parameters::geometry;
use crate::encoder_scaling;
use crate::error::BuildError;
use crate::payload::packed;
use crate::sensor_set::Sensors;
use loadtwin_machine::{Bearing, Channel, Machine, MachineError, Senses, Violation, extreme_words};

/// Load at the end of the scale on the bus, in ranges: room beyond the described range, at steps of
/// 3e-5 ranges.
const FULL_SCALE: f64 = 4.0;

/// Standard deviation at which an estimate is no longer valid, in ranges: the band of twice it is
/// then 40 % of the range.
const VALID_STD: f64 = 0.2;

/// Smallest standard deviation of a load about what is expected, in ranges.
const LEAST_LOAD_STD: f64 = 0.01;

/// The calibration that the description names.
///
/// # Errors
/// When the bearing is not calibrated or its calibration cannot be read.
pub fn calibration(machine: &Machine, bearing: &Bearing) -> Result<Calibration, BuildError> {
    let Some(file) = &bearing.calibration else {
        let text = loadtwin_machine::read_description(&machine.path).unwrap_or_default();
        return Err(BuildError::Machine(MachineError::violation(
            &machine.path,
            &text,
            Violation {
                field: "bearing.calibration".into(),
                found: "nothing".into(),
                allowed: "a file that `loadtwin calibrate` wrote".into(),
            },
        )));
    };
    Ok(Calibration::read(
        &machine.resolve(file),
        bearing.gauges.len(),
    )?)
}

/// The image's payload with the calibration that the description names.
///
/// # Errors
/// When the bearing is not calibrated, its calibration cannot be read or the
/// description does not fit the model.
pub fn image(
    machine: &Machine,
    bearing: &Bearing,
    sensors: &Sensors,
) -> Result<Vec<u8>, BuildError> {
    let calibration = calibration(machine, bearing)?;
    let model = model(machine, bearing, sensors, &calibration)?;
    packed(machine, &sensors.channels, Model::Bearing(model))
}

/// The model of the bearing with `calibration`.
///
/// # Errors
/// When the description does not fit the model.
pub fn model(
    machine: &Machine,
    bearing: &Bearing,
    sensors: &Sensors,
    calibration: &Calibration,
) -> Result<BearingModel, BuildError> {
    let geometry = geometry(bearing, &calibration.physical)?;
    let channel = |gauge: usize| -> Result<&Channel, BuildError> {
        let name = &bearing.gauges[gauge].name;
        (sensors.channels.get(gauge))
            .filter(|c| matches!(&c.senses, Senses::OuterRing(sensed) if sensed == name))
            .ok_or(BuildError::Model(loadtwin_common::Error::OutOfRange(
                "channels: one for each gauge, in the order of the gauges",
            )))
    };
    let mut gauges = Vec::new();
    for g in 0..GAUGES {
        gauges.push(gauge(channel(g)?, bearing, calibration, g));
    }
    let Ok(gauges): Result<[GaugeModel; GAUGES], _> = gauges.try_into() else {
        return Err(BuildError::TooLarge("gauges"));
    };
    let encoder =
        sensors
            .encoders
            .first()
            .ok_or(BuildError::Model(loadtwin_common::Error::OutOfRange(
                "encoders: one, of the wheel",
            )))?;
    let ratio =
        0.5 * (1.0 - bearing.ball_mm / bearing.pitch_mm * f64::from(geometry.contact_angle.0));
    let loads = machine
        .loads()
        .iter()
        .map(|load| {
            Ok(LoadSignal {
                name: load
                    .name
                    .try_into()
                    .map_err(|_| BuildError::TooLarge("a load's name"))?,
                full_scale: (load.nominal * FULL_SCALE) as f32,
                valid_std: (load.nominal * VALID_STD) as f32,
            })
        })
        .collect::<Result<_, BuildError>>()?;
    Ok(BearingModel {
        loads,
        gauges,
        counter: encoder_scaling::counter(encoder, 1.0),
        passes_per_turn: (f64::from(bearing.balls) * ratio) as f32,
        tuning: tuning(bearing, calibration, f64::from(geometry.radius_mm))?,
        geometry,
    })
}

fn gauge(channel: &Channel, bearing: &Bearing, calibration: &Calibration, g: usize) -> GaugeModel {
    let answer = &calibration.gauge[g];
    let passing = f64::from(bearing.balls) * bearing.gauges[g].azimuth_deg.to_radians();
    let [lowest, highest] = extreme_words(channel.converter().bits);
    GaugeModel {
        converter: AdcScaling {
            zero: channel.zero_word(),
            gain: (channel.lsb_si() * 1e6) as f32,
            lowest,
            highest,
            stuck_after: channel.stuck_after(),
        },
        passing: (passing.rem_euclid(2.0 * PI)) as f32,
        noise_std: answer.noise_std as f32,
        resting_error: answer.resting_error as f32,
        model_error: answer.model_error as f32,
        offset: answer.offset as f32,
        bulk_load: answer.bulk_load.map(|c| c as f32),
        bulk_feature: answer.bulk_feature.map(|row| row.map(|c| c as f32)),
        local: answer
            .local
            .map(|row| row.map(|harmonic| harmonic.map(|feature| feature.map(|c| c as f32)))),
    }
}

fn tuning(
    bearing: &Bearing,
    calibration: &Calibration,
    radius_mm: f64,
) -> Result<Tuning, BuildError> {
    let f = &bearing.filter;
    // Loads in N and N m; the filter has kN, moments over the radius.
    let unit = |i: usize| if i < 3 { 1e-3 } else { 1.0 / radius_mm };
    let ranges = bearing.range.all();
    let covariance = Mat::from_fn(LOADS, LOADS, |i, j| {
        let least = LEAST_LOAD_STD * (ranges[i][1] - ranges[i][0]);
        let least = if i == j { least * least } else { 0.0 };
        (calibration.load_covariance[i][j] + least) * unit(i) * unit(j)
    });
    let factor = covariance.llt(Side::Lower).map_err(|_| {
        BuildError::Model(loadtwin_common::Error::NotPositive(
            "load_covariance of the calibration",
        ))
    })?;
    let below = |i: usize, j: usize| if j <= i { factor.L()[(i, j)] } else { 0.0 };
    Ok(Tuning {
        slip_time_s: f.slip_time_s as f32,
        slip_std: f.slip_std as f32,
        slip_limit: f.slip_limit as f32,
        phase_walk: f.phase_walk as f32,
        load_mean: std::array::from_fn(|i| (calibration.load_mean[i] * unit(i)) as f32),
        load_factor: std::array::from_fn(|i| std::array::from_fn(|j| below(i, j) as f32)),
        load_time_s: f.load_time_s as f32,
        preload_std: f.preload_std_um as f32,
        preload_walk: f.preload_walk_um as f32,
        bias_std: f.bias_std as f32,
        bias_time_s: f.bias_time_s as f32,
        bulk_std: f.bulk_std as f32,
        lowest_hz: f.lowest_hz as f32,
    })
}
