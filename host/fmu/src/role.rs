//! What a variable of an FMU stands for (`Role`): time; as input a reading or angle, whether each
//! was delivered, the index pulse and the turn since it; as output a field of a load or sensor,
//! the shaft angle, whether it is homed, whether gains are steady. Gives the variable's type,
//! whether the environment sets it, and whether it starts true.

/// What a variable stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The time.
    Time,
    /// Reading of an analogue channel.
    Reading(usize),
    /// Whether that reading was delivered.
    ReadingDelivered(usize),
    /// Angle or travel of an encoder.
    Angle(usize),
    /// Whether that angle was delivered.
    AngleDelivered(usize),
    /// The level of the index pulse.
    Index,
    /// How far the encoder has turned since the index pulse.
    SinceIndex,
    /// A load.
    Load(usize, LoadField),
    /// A sensor, channels before encoders.
    Sensor(usize, SensorField),
    /// Angle of carrier or shaft.
    ShaftAngle,
    /// Whether that is homed.
    Homed,
    /// Whether the estimate is by gains computed beforehand.
    Steady,
}

/// What is estimated of a load.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadField {
    /// The load.
    Value,
    /// Its standard deviation.
    Std,
    /// Whether it is valid.
    Valid,
    /// Why not.
    Fault,
}

/// What is estimated of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorField {
    /// Reading minus prediction.
    Innovation,
    /// Its normalised square.
    Nis,
    /// Why the reading was not used.
    Fault,
}

/// Type of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// f64.
    Real,
    /// i32.
    Integer,
    /// Truth.
    Boolean,
}

impl Role {
    /// Type of its variable.
    pub fn of_type(self) -> Type {
        match self {
            Self::Time
            | Self::Reading(_)
            | Self::Angle(_)
            | Self::SinceIndex
            | Self::Load(_, LoadField::Value | LoadField::Std)
            | Self::Sensor(_, SensorField::Innovation | SensorField::Nis)
            | Self::ShaftAngle => Type::Real,
            Self::ReadingDelivered(_)
            | Self::AngleDelivered(_)
            | Self::Index
            | Self::Load(_, LoadField::Valid)
            | Self::Homed
            | Self::Steady => Type::Boolean,
            Self::Load(_, LoadField::Fault) | Self::Sensor(_, SensorField::Fault) => Type::Integer,
        }
    }

    /// Whether the environment sets it.
    pub fn is_input(self) -> bool {
        matches!(
            self,
            Self::Reading(_)
                | Self::ReadingDelivered(_)
                | Self::Angle(_)
                | Self::AngleDelivered(_)
                | Self::Index
                | Self::SinceIndex
        )
    }

    /// Whether it holds before the environment sets it.
    pub fn starts_true(self) -> bool {
        matches!(self, Self::ReadingDelivered(_) | Self::AngleDelivered(_))
    }
}
