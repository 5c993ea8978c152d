//! A load that all channels read and that is not torque.

use super::{Effect, GaugeModel, Linear, one_shape};
use crate::signals::slow;
use crate::statistics::mean;
use crate::stream::{Kind, Session, Stream, Term};
use crate::thin::filled;
use loadtwin_machine::{Drift, Machine};

/// Highest frequency of the common load [Hz].
const HIGHEST_HZ: f64 = 0.6;

/// `scale a L(t)`: a slow load `L` that is the same for all channels, told for
/// each channel by the others. What is left of it in one channel is not used
/// to explain that channel.
pub struct Bending;

impl Effect for Bending {
    fn name(&self) -> &'static str {
        "bending-load"
    }
    fn about(&self) -> &'static str {
        "a slow load that is not torque and that all channels read"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the other channels' mean",
            prior_std: 1.0,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        let strains = session.streams.iter().filter(|s| s.kind == Kind::Strain);
        if strains.count() >= 3 {
            one_shape()
        } else {
            Vec::new()
        }
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Strain
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        let Common { slow, sum, total } = Common::new(session);
        let columns = session
            .streams
            .iter()
            .zip(&slow)
            .map(|(stream, slow)| {
                slow.as_ref().map_or(Vec::new(), |slow| {
                    let w = weight(stream);
                    sum.iter()
                        .zip(slow)
                        .map(|(sum, own)| stream.scale * (sum - w * own) / (total - w))
                        .collect()
                })
            })
            .collect();
        vec![Term::Each(columns)]
    }
    /// Of the mean of all channels, where the parameter is of that of the others:
    /// `g = a (1 - w g) / (1 - w)`, `w` its weight in the mean.
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.bending == 0.0;
        if is_new {
            let of_others = parameters[0];
            let of_all = of_others / (1.0 + (of_others - 1.0) * gauge.weight);
            gauge.bending = of_all * gauge.full_scale;
        }
        is_new
    }
    /// As a first-order lag that is as large and changes as fast.
    fn mend_machine(&self, session: &Session, _: &[f64], _: &[f64], machine: &mut Machine) -> bool {
        let Some(chain) = &mut machine.drivetrain else {
            return false;
        };
        let Common { sum, total, .. } = Common::new(session);
        let rms = |x: &mut dyn Iterator<Item = f64>| {
            let (square, n) = x.fold((0.0, 0.0), |(square, n), x| (square + x * x, n + 1.0));
            f64::sqrt(square / f64::max(n, 1.0))
        };
        let size = rms(&mut sum.iter().copied());
        let change = rms(&mut sum.windows(2).map(|w| w[1] - w[0]));
        let is_new = chain.bending.is_none() && change > 0.0;
        if is_new {
            chain.bending = Some(Drift {
                std: size / total,
                time_s: session.signals.dt_s * size / change,
            });
        }
        is_new
    }
    fn latent(&self, session: &Session) -> f64 {
        2.0 * HIGHEST_HZ * session.signals.dt_s * session.signals.len() as f64
    }
    fn experiment(&self) -> &'static str {
        "a known bending load without torque; gauges in antisymmetric pairs"
    }
}

/// The slow load as each channel has it, and as all have it together.
struct Common {
    /// Of each stream that is a strain, in parts of its full scale.
    slow: Vec<Option<Vec<f64>>>,
    /// Sum of these, weighted.
    sum: Vec<f64>,
    /// Sum of the weights.
    total: f64,
}

impl Common {
    fn new(session: &Session) -> Self {
        let slow: Vec<Option<Vec<f64>>> = session
            .streams
            .iter()
            .map(|s| (s.kind == Kind::Strain).then(|| slow_part(s, session.signals.dt_s)))
            .collect();
        let mut sum = vec![0.0; session.signals.len()];
        let mut total = 0.0;
        for (stream, slow) in session.streams.iter().zip(&slow) {
            if let Some(slow) = slow {
                total += weight(stream);
                for (sum, value) in sum.iter_mut().zip(slow) {
                    *sum += weight(stream) * value;
                }
            }
        }
        Self { slow, sum, total }
    }
}

/// Takes the described load out of the strains, which tell it together: sample by sample
///
/// `L = sum_k g_k r_k / v_k / (1 / std^2 + sum_k g_k^2 / v_k)`, `r_k <- r_k - g_k L`.
pub(crate) fn take_out(machine: &Machine, strains: &mut [Stream]) {
    let described = machine.drivetrain.as_ref().and_then(|d| d.bending);
    let Some(Drift { std, .. }) = described else {
        return;
    };
    let reading = |stream: &Stream| {
        let channel = machine.channels.iter().find(|c| c.name == stream.name);
        channel.map_or(0.0, |channel| channel.to_si(channel.bending))
    };
    let readings: Vec<f64> = strains.iter().map(reading).collect();
    for i in 0..strains.first().map_or(0, |s| s.residual.len()) {
        let (mut told, mut known) = (0.0, std.powi(-2));
        for (stream, g) in strains.iter().zip(&readings) {
            if stream.residual[i].is_finite() {
                let weight = g / (stream.noise_std * stream.noise_std);
                told += weight * stream.residual[i];
                known += weight * g;
            }
        }
        for (stream, g) in strains.iter_mut().zip(&readings) {
            stream.residual[i] -= g * told / known;
        }
    }
}

/// What a channel knows of a load that all read.
pub(crate) fn weight(stream: &Stream) -> f64 {
    (stream.scale / stream.noise_std).powi(2)
}

/// Slow part of a residual about its mean, in parts of full scale; what is not known is as before.
fn slow_part(stream: &Stream, dt_s: f64) -> Vec<f64> {
    let mut slow = slow(&filled(&stream.residual), dt_s, HIGHEST_HZ);
    let mean = mean(slow.iter().copied());
    for value in &mut slow {
        *value = (*value - mean) / stream.scale;
    }
    slow
}
