//! Reads a drivetrain recording as residuals, measurement minus model output, given the torque by
//! reference loads or else by the gauges; without either, as the innovations of the filter.

use std::collections::HashMap;
use std::path::Path;

use crate::diagnosis::DiagnoseError;
use crate::drivetrain::chain_response::ShaftResponse;
use crate::drivetrain::common_mode::remove_common_mode;
use crate::drivetrain::decimated_signals::Signals;
use crate::drivetrain::decimation::{Decimator, forward_filled};
use crate::drivetrain::gauge_median;
use crate::drivetrain::inverse_dynamics::{InertiaMotion, ShaftTorques};
use crate::drivetrain::known_torques::{
    drives, loads, operating_profile, operating_profile_from_shaft,
};
use crate::drivetrain::plausibility::{SHORTEST_OF_SEVERAL_S, SHORTEST_S, implausibility};
use crate::drivetrain::recorded_samples::{DrivetrainRecording, Outliers, derivatives};
use crate::drivetrain::residual_computation::{RecordingContext, smoothing_width};
use crate::drivetrain::residual_signals::{
    DrivetrainResiduals, Kind, ResidualSignal, TorqueSource, product,
};
use crate::filter_run::Filtered;
use crate::smoothing::smooth;
use loadtwin_design::gearbox::Torsion;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{LATEST_S, Machine, MachineError};

/// Samples a second on which effects are tested.
const RATE_HZ: f64 = 125.0;

/// Inertia of a gear that a description has in its neighbours, part of the smaller one's.
const GEAR: f64 = 0.01;

/// Reads `path` as residuals of `machine` as described, given the torque measured by the references
/// or, without them, estimated from the gauges together; where these are too few, as the
/// innovations of the filter.
///
/// # Errors
/// When the recording cannot be read, is too short to be tested, shows next to
/// nothing, or contradicts the description.
pub fn read_residuals(
    machine: &Machine,
    path: &Path,
) -> Result<DrivetrainResiduals, DiagnoseError> {
    read_residuals_given(machine, path, TorqueSource::References)
}

/// As [`read_residuals`], given the torque from `torque_source` or, where that is missing, from the
/// gauges or the filter.
pub(crate) fn read_residuals_given(
    machine: &Machine,
    path: &Path,
    mut torque_source: TorqueSource,
) -> Result<DrivetrainResiduals, DiagnoseError> {
    let mut context = read_given(machine, path, torque_source)?;
    if torque_source == TorqueSource::References && context.known.iter().all(Option::is_none) {
        torque_source = TorqueSource::Gauges;
    }
    if torque_source != TorqueSource::References {
        context.torques = gauge_median::torques(machine, context.drivetrain, &context.recorded)?;
    }
    let mut innovations = Vec::new();
    if torque_source != TorqueSource::References
        && context.torques.shafts.iter().all(Option::is_none)
    {
        torque_source = TorqueSource::Filter;
        let filtered = Filtered::run(machine, &Sensors::choose(machine, None)?, path)?;
        let load = |of: &Vec<f64>| Some(smooth(&forward_filled(of), context.width()));
        context.known = filtered.loads.iter().map(load).collect();
        context.torques = context.torques_of(context.drivetrain);
        innovations = filtered.innovations;
    }
    let recording = recording(&context, torque_source, &innovations)?;
    match implausibility(&recording) {
        Some(reason) => Err(DiagnoseError::TooLittle {
            recording: path.to_owned(),
            reason,
        }),
        None => Ok(recording),
    }
}

/// Reads `path` with the torques that follow from its references, where these are `torque_source`.
///
/// # Errors
/// When the recording cannot be read or is too short.
pub(crate) fn read_given<'a>(
    machine: &'a Machine,
    path: &Path,
    torque_source: TorqueSource,
) -> Result<RecordingContext<'a>, DiagnoseError> {
    let drivetrain = machine
        .drivetrain
        .as_ref()
        .ok_or(DiagnoseError::NoDrivetrain)?;
    let recorded = DrivetrainRecording::read(machine, path)?;
    let duration = recorded.len() as f64 * recorded.dt_s;
    if duration < SHORTEST_OF_SEVERAL_S {
        return Err(DiagnoseError::TooLittle {
            recording: path.to_owned(),
            reason: format!(
                "{duration:.1} s are too short to tell an effect from chance; at least {SHORTEST_OF_SEVERAL_S} s are \
                 needed, and {SHORTEST_S} s in all recordings that are fitted"
            ),
        });
    }
    let width = smoothing_width(recorded.dt_s);
    let (speeds, accelerations): (Vec<_>, Vec<_>) = recorded
        .encoders
        .iter()
        .map(|angle| derivatives(angle, width, recorded.dt_s))
        .unzip();
    let every = ((1.0 / (recorded.dt_s * RATE_HZ)).round() as usize).max(1);
    // Nor is known what a gauge reads that is late by as much as is looked for, and the samples
    // beside that.
    let late = (LATEST_S / recorded.dt_s) as usize + 2 * every;
    let mut context = RecordingContext {
        machine,
        drivetrain,
        thin: Decimator {
            every,
            edge: 2 * width + late,
            n: recorded.len(),
        },
        torsion: Torsion::new(drivetrain),
        motion: InertiaMotion::new(machine, drivetrain, &speeds, &accelerations),
        known: match torque_source {
            TorqueSource::References => loads(machine, drivetrain, &recorded),
            TorqueSource::Gauges | TorqueSource::Filter => vec![None; drivetrain.loads.len()],
        },
        drives: drives(machine, drivetrain, &recorded),
        recorded,
        torques: ShaftTorques::default(),
    };
    context.torques = context.torques_of(drivetrain);
    Ok(context)
}

/// All residuals of `context`, given the torque from `torque_source`.
pub(crate) fn recording(
    context: &RecordingContext<'_>,
    torque_source: TorqueSource,
    innovations: &[(String, Vec<f64>)],
) -> Result<DrivetrainResiduals, MachineError> {
    let signals = context.signals();
    let residuals = match torque_source {
        TorqueSource::References | TorqueSource::Gauges => residuals(context, &signals)?,
        TorqueSource::Filter => context.innovations(innovations),
    };
    let operating_profile = match torque_source {
        TorqueSource::References | TorqueSource::Filter => operating_profile(
            context.drivetrain,
            &context.torsion,
            &context.recorded,
            &context.motion,
            &context.known,
            &context.drives,
        ),
        TorqueSource::Gauges => Some(operating_profile_from_shaft(
            context.drivetrain,
            &context.torsion,
            &context.recorded,
            &context.motion,
            &context.level(),
        )),
    };
    Ok(DrivetrainResiduals {
        twist: context.twist(),
        signals,
        residuals,
        operating_profile,
        torque_source,
        missing_references: context.missing_references(),
        reference_noise: context.reference_noise(),
    })
}

/// Residuals of each channel, the torque balance and the angles of further encoders.
fn residuals(
    context: &RecordingContext<'_>,
    signals: &Signals,
) -> Result<Vec<ResidualSignal>, MachineError> {
    let mut residuals = Vec::new();
    let mut spikes = Vec::new();
    for channel in 0..context.machine.channels.len() {
        if let Some((signal, stand_out)) = context.strain(channel)? {
            residuals.push(signal);
            spikes.push(stand_out);
        }
    }
    for (signal, count) in residuals.iter_mut().zip(isolated_spikes(&spikes)) {
        signal.spikes = count;
    }
    remove_common_mode(context.machine, &mut residuals);
    residuals.extend(context.balance());
    residuals.extend((1..context.machine.encoders.len()).filter_map(|k| context.angle(k)));
    remove_carrier_offset(&mut residuals, signals.count);
    add_parameter_sensitivities(&mut residuals, signals);
    Ok(residuals)
}

/// How many samples of each channel stand out while no other channel's does, beyond those that the tail of its
/// noise gives: what all have in common happens to the machine, and not to a word.
fn isolated_spikes(spikes: &[Outliers]) -> Vec<u64> {
    let mut channels: HashMap<usize, u32> = HashMap::new();
    for at in spikes.iter().flat_map(|own| &own.at) {
        *channels.entry(*at).or_default() += 1;
    }
    spikes
        .iter()
        .map(|own| {
            let alone = own.at.iter().filter(|at| channels[*at] == 1).count() as u64;
            alone.saturating_sub(own.of_tail)
        })
        .collect()
}

/// Subtracts the error that the counts of the index's encoder cause in the
/// carrier angle: the shift on which most maps agree, up to two counts, beyond
/// the residuals of a fault-free machine.
pub(crate) fn remove_carrier_offset(residuals: &mut [ResidualSignal], count: f64) {
    let mut torque_source: Vec<(f64, f64)> = (residuals.iter())
        .filter(|s| s.over_angle())
        .filter_map(shift_of_map)
        .collect();
    if torque_source.is_empty() {
        return;
    }
    // A gauge with a delay or another place may be far off.
    let shift = gauge_median::median(&mut torque_source).clamp(-2.0 * count, 2.0 * count);
    for signal in residuals.iter_mut().filter(|s| s.over_angle()) {
        for (r, slope) in signal.residual.iter_mut().zip(&signal.slope) {
            *r -= shift * slope;
        }
    }
}

/// The shift of the carrier angle that explains most of a residual [rad], and its weight.
fn shift_of_map(signal: &ResidualSignal) -> Option<(f64, f64)> {
    let fault_free = |i: usize| signal.fault_free.get(i).copied().unwrap_or(0.0);
    let known: Vec<(f64, f64)> = (signal.residual.iter().zip(&signal.slope).enumerate())
        .map(|(i, (r, slope))| (r - fault_free(i), *slope))
        .filter(|(r, _)| r.is_finite())
        .collect();
    let mean = known.iter().map(|k| k.0).sum::<f64>() / known.len().max(1) as f64;
    let product: f64 = known.iter().map(|(r, slope)| slope * (r - mean)).sum();
    let square: f64 = known.iter().map(|(_, slope)| slope * slope).sum();
    (square > 0.0).then(|| (product / square, square * signal.noise_std.powi(-2)))
}

/// Change of each residual with the uncertain parameters of the chain: the stiffness and the
/// damping of the shafts, which decide for how long a vibration stays in step with the simulated
/// one, gears whose inertia the description has in their neighbours, and the inertias; and what
/// vibrates at the start.
fn add_parameter_sensitivities(residuals: &mut [ResidualSignal], signals: &Signals) {
    let Some(response) = &signals.response else {
        return;
    };
    let driven = &response.driven;
    let fast = |changes: Vec<ShaftResponse>| changes.into_iter().map(|c| signals.high_passed(c));
    let shafts = 0..response.stiffness.len();
    let gears = shafts.filter_map(|s| signals.with_gear(s, GEAR));
    let parameter_sensitivities: Vec<ShaftResponse> =
        fast(driven.stiffness_sensitivities(&response.carried))
            .chain(gears)
            .chain(signals.inertia_sensitivities())
            .collect();
    let initial_vibrations: Vec<ShaftResponse> = fast(driven.initial_vibrations()).collect();
    for signal in residuals {
        let column = |change: &ShaftResponse| match (signal.kind, signal.shaft) {
            (Kind::Strain, Some(s)) => Some(product(&signal.map, &change.torque[s])),
            (Kind::Angle, _) => Some(signal.along_twists(&change.twist)),
            _ => None,
        };
        (signal.parameter_sensitivities, signal.initial_vibrations) = (
            parameter_sensitivities.iter().filter_map(column).collect(),
            initial_vibrations.iter().filter_map(column).collect(),
        );
    }
}
