//! Computes the error of an estimated load against a reference, sample by sample: NMAE, RMSE and
//! bias, over the whole recording and by segment.

/// A named stretch of time, `from_s <= t < to_s`.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Name in the error table.
    pub name: String,
    /// Start (s), included.
    pub from_s: f64,
    /// End (s), not included; infinite for "to the end".
    pub to_s: f64,
}

/// Error of one load over one stretch of time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorFigures {
    /// Samples that have both an estimate and a reference.
    pub samples: u64,
    /// Samples that have a reference but no finite estimate; they are in no figure.
    pub missing: u64,
    absolute: f64,
    squared: f64,
    signed: f64,
}

impl ErrorFigures {
    fn push(&mut self, error: f64) {
        if error.is_finite() {
            self.samples += 1;
            self.absolute += error.abs();
            self.squared += error * error;
            self.signed += error;
        } else {
            self.missing += 1;
        }
    }

    fn per_sample(&self, sum: f64) -> Option<f64> {
        (self.samples > 0).then(|| sum / self.samples as f64)
    }

    /// `100 mean|estimate - reference| / nominal` [%]; `nominal` in the load's unit.
    ///
    /// Source: Bosmans et al. 2023, section 5.2 (normalised by the nominal torque).
    pub fn nmae_percent(&self, nominal: f64) -> Option<f64> {
        self.per_sample(self.absolute)
            .map(|mae| 100.0 * mae / nominal)
    }

    /// `sqrt(mean (estimate - reference)^2)`, in the load's unit.
    pub fn rmse(&self) -> Option<f64> {
        self.per_sample(self.squared).map(f64::sqrt)
    }

    /// `mean(estimate - reference)`, in the load's unit.
    pub fn bias(&self) -> Option<f64> {
        self.per_sample(self.signed)
    }
}

/// Error of one load over the whole recording and over each segment.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadError {
    full: ErrorFigures,
    segments: Vec<(Segment, ErrorFigures)>,
}

impl LoadError {
    /// An empty sum. Segments may overlap or leave time out.
    pub fn new(segments: Vec<Segment>) -> Self {
        Self {
            full: ErrorFigures::default(),
            segments: segments
                .into_iter()
                .map(|segment| (segment, ErrorFigures::default()))
                .collect(),
        }
    }

    /// Takes one sample at `t_s` (s); estimate and reference in the load's unit.
    ///
    /// A reference that is not finite is no reference: the sample is passed over.
    pub fn push(&mut self, t_s: f64, estimate: f64, reference: f64) {
        if !reference.is_finite() {
            return;
        }
        let error = estimate - reference;
        self.full.push(error);
        for (segment, figures) in &mut self.segments {
            if (segment.from_s..segment.to_s).contains(&t_s) {
                figures.push(error);
            }
        }
    }

    /// Over everything.
    pub fn full(&self) -> &ErrorFigures {
        &self.full
    }

    /// Over each segment, in the order given.
    pub fn segments(&self) -> impl Iterator<Item = (&str, &ErrorFigures)> {
        self.segments
            .iter()
            .map(|(segment, figures)| (segment.name.as_str(), figures))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(name: &str, from_s: f64, to_s: f64) -> Segment {
        Segment {
            name: name.to_owned(),
            from_s,
            to_s,
        }
    }

    /// Errors 1, -3, 2 (nominal 50): NMAE 4 %, RMSE sqrt(14/3), bias 0; the ramp holds the first
    /// two, the dwell begins on the third.
    #[test]
    fn worked_by_hand() {
        let mut error = LoadError::new(vec![
            segment("ramp", 0.0, 2.0),
            segment("dwell", 2.0, f64::INFINITY),
            segment("later", 90.0, 99.0),
        ]);
        for (t_s, estimate, reference) in [(0.0, 11.0, 10.0), (1.0, 17.0, 20.0), (2.0, 32.0, 30.0)]
        {
            error.push(t_s, estimate, reference);
        }
        error.push(3.0, 1e9, f64::NAN);
        error.push(4.0, f64::NAN, 30.0);
        let full = error.full();
        assert_eq!((full.samples, full.missing), (3, 1));
        assert_eq!(full.nmae_percent(50.0), Some(4.0));
        assert_eq!(full.bias(), Some(0.0));
        assert!((full.rmse().unwrap() - (14.0f64 / 3.0).sqrt()).abs() < 1e-15);
        let by_segment: Vec<_> = error
            .segments()
            .map(|(name, figures)| (name, figures.nmae_percent(100.0)))
            .collect();
        assert_eq!(
            by_segment,
            [("ramp", Some(2.0)), ("dwell", Some(2.0)), ("later", None)]
        );
    }
}
