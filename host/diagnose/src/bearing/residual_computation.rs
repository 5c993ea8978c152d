//! Computes the residuals of one recording of a bearing, block by block: bulk and local strain of
//! each gauge and slip of each cage, minus the prediction of its calibration. The drift of the
//! offsets, a cubic in time, is projected out.

use loadtwin_common::bearing::{BASIS, GAUGES, ROWS};

use crate::bearing::recorded_blocks::BearingRecording;
use crate::bearing::{Kind, STREAMS};
use crate::diagnosis::DiagnoseError;
use crate::regression::projection::NuisanceProjection;
use crate::residual_model::SignalSet;
use loadtwin_design::bearing::{
    Calibration, DRIFT_TERMS, Prediction, Rig, cage_slip, predict_readings,
};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Bearing, Machine};

/// The part of a recording that no effect changes.
pub(crate) struct BearingContext {
    pub machine: Machine,
    pub bearing: Bearing,
    pub sensors: Sensors,
    pub calibration: Calibration,
    pub recorded: BearingRecording,
    /// Prediction of the calibration for each block that was followed.
    pub predicted: Vec<Prediction>,
    /// Of each block of the recording, its place among those that were followed.
    place: Vec<Option<usize>>,
    /// What an offset that warms up does.
    pub projection: NuisanceProjection,
}

impl BearingContext {
    /// What `recorded` shows of the bearing.
    pub fn new(
        rig: &Rig<'_>,
        calibration: &Calibration,
        recorded: BearingRecording,
    ) -> Result<Self, DiagnoseError> {
        let mut place = vec![None; recorded.course.speed.len()];
        for (at, known) in recorded.known.iter().enumerate() {
            place[known.number] = Some(at);
        }
        let mut context = Self {
            machine: rig.machine.clone(),
            bearing: rig.bearing.clone(),
            sensors: rig.sensors.clone(),
            calibration: calibration.clone(),
            predicted: predict_readings(rig, &recorded.known, calibration)?,
            projection: NuisanceProjection::new(Vec::new(), &[], Vec::new()),
            recorded,
            place,
        };
        context.projection = context.drift();
        Ok(context)
    }

    /// What the same bearing with another calibration would have read.
    pub fn predicted_with(&self, calibration: &Calibration) -> Option<Vec<Prediction>> {
        let rig = Rig {
            machine: &self.machine,
            bearing: &self.bearing,
            sensors: &self.sensors,
        };
        predict_readings(&rig, &self.recorded.known, calibration).ok()
    }

    /// Blocks of the recording.
    pub fn len(&self) -> usize {
        self.place.len()
    }

    /// The place of a block among those that were followed.
    pub fn place(&self, block: usize) -> Option<usize> {
        self.place[block]
    }

    /// Residuals of the readings; NaN where there are none.
    pub fn residual(&self) -> SignalSet {
        let whole: SignalSet = (0..STREAMS).map(|k| self.untouched(Kind::of(k))).collect();
        let mut left = (self.projection).annihilate(
            (whole.iter())
                .map(|of| of.iter().copied().map(known).collect())
                .collect(),
        );
        for (left, whole) in left.iter_mut().zip(&whole) {
            for (left, whole) in left.iter_mut().zip(whole) {
                if !whole.is_finite() {
                    *left = f64::NAN;
                }
            }
        }
        left
    }

    /// Residual before the projection on offsets.
    fn untouched(&self, kind: Kind) -> Vec<f64> {
        (0..self.len())
            .map(|i| {
                let value = self.place[i].and_then(|at| match kind {
                    Kind::Bulk(g) => Some(self.left(at, g)?[0]),
                    Kind::Local(g) => self.along(at, g, &self.left(at, g)?),
                    Kind::Slip(row) => Some(self.slip(at, row)? - self.calibration.cage_slip[row]),
                });
                value.unwrap_or(f64::NAN)
            })
            .collect()
    }

    /// Readings of a gauge less their prediction.
    fn left(&self, at: usize, g: usize) -> Option<[f64; BASIS]> {
        let block = &self.recorded.known[at].block;
        let share = f64::from(block.count).sqrt().recip();
        let (read, predicted) = (&block.reading[g], &self.predicted[at].strain[g]);
        block.complete[g]
            .then(|| std::array::from_fn(|k| share * f64::from(read[k]) - predicted[k]))
    }

    /// The part of a gauge's `strain` that goes with the balls along the predicted one; none
    /// where that drowns in noise.
    pub fn along(&self, at: usize, g: usize, strain: &[f64; BASIS]) -> Option<f64> {
        let predicted = &self.predicted[at].strain[g][1..];
        let size = predicted.iter().map(|c| c * c).sum::<f64>().sqrt();
        let product: f64 = predicted.iter().zip(&strain[1..]).map(|(a, b)| a * b).sum();
        (size > self.calibration.gauge[g].noise_std).then(|| product / size)
    }

    /// By which part the cage of a row went faster than predicted since the block before.
    fn slip(&self, at: usize, row: usize) -> Option<f64> {
        cage_slip(
            &self.recorded.known,
            &self.predicted,
            self.recorded.rate,
            at,
            row,
        )
    }

    /// By which part the cages went faster than predicted, on average.
    pub fn mean_slip(&self) -> f64 {
        let slips = (0..ROWS).flat_map(|row| {
            (0..self.recorded.known.len()).filter_map(move |at| self.slip(at, row))
        });
        let (sum, n) = (slips.filter(|slip| slip.is_finite()))
            .fold((0.0, 0.0), |(sum, n), slip| (sum + slip, n + 1.0));
        sum / f64::max(n, 1.0)
    }

    /// Powers of the time in the bulk strain of each gauge.
    fn drift(&self) -> NuisanceProjection {
        let n = self.len();
        let weights = (0..STREAMS)
            .map(|k| {
                let residual = self.untouched(Kind::of(k));
                residual
                    .iter()
                    .map(|r| f64::from(u8::from(r.is_finite())))
                    .collect()
            })
            .collect();
        let columns: Vec<SignalSet> = (0..GAUGES)
            .flat_map(|g| (0..DRIFT_TERMS).map(move |power| (g, power)))
            .map(|(g, power)| {
                let mut column = vec![vec![0.0; n]; STREAMS];
                for (i, value) in column[g].iter_mut().enumerate() {
                    *value = (2.0 * i as f64 / n as f64 - 1.0).powi(power as i32);
                }
                column
            })
            .collect();
        let stds = vec![f64::INFINITY; columns.len()];
        NuisanceProjection::new(columns, &stds, weights)
    }
}

/// 0 where nothing was measured.
fn known(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}
