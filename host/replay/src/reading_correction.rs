//! Defines a correction of how a recording is read, by which the consistency check tests its
//! hypotheses: the column that each sensor takes, a factor on it, and an offset of each channel.

use loadtwin_design::image_build::Sensors;

/// The column that a channel takes, and what its reading is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// The channel whose column it is.
    pub from: usize,
    /// Factor on the reading.
    pub factor: f64,
    /// Added to it [SI unit of the reading].
    pub offset: f64,
}

/// Which column each sensor takes, and how it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// For each channel.
    pub channels: Vec<Affine>,
    /// For each encoder the encoder whose column it takes, and the factor on the counts.
    pub encoders: Vec<(usize, f64)>,
}

impl Correction {
    /// Everything as described.
    pub fn none(sensors: &Sensors) -> Self {
        let as_described = |from| Affine {
            from,
            factor: 1.0,
            offset: 0.0,
        };
        Self {
            channels: (0..sensors.channels.len()).map(as_described).collect(),
            encoders: (0..sensors.encoders.len()).map(|k| (k, 1.0)).collect(),
        }
    }
}
