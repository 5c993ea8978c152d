//! Bit positions of the CAN signals. Generated from `docs/loadtwin.dbc`; a test of `loadtwin` compares
//! both and, with `LOADTWIN_BLESS=1`, writes this file anew.

/// `Status`.
pub mod status {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 0;
    /// Signal `Crc`.
    pub const CRC: Field = Field::unsigned(0, 16);
    /// Signal `Counter`.
    pub const COUNTER: Field = Field::unsigned(16, 8);
    /// Signal `Page`.
    pub const PAGE: Field = Field::unsigned(24, 4);
    /// Signal `State`.
    pub const STATE: Field = Field::unsigned(28, 4);
    /// Signal `ImageHash`.
    pub const IMAGE_HASH: Field = Field::unsigned(32, 32);
    /// Signal `Overruns`.
    pub const OVERRUNS: Field = Field::unsigned(32, 16);
    /// Signal `Missed`.
    pub const MISSED: Field = Field::unsigned(48, 16);
    /// Signal `BusOff`.
    pub const BUS_OFF: Field = Field::unsigned(32, 16);
    /// Signal `QueueOverflow`.
    pub const QUEUE_OVERFLOW: Field = Field::unsigned(48, 16);
    /// Signal `Refused`.
    pub const REFUSED: Field = Field::unsigned(32, 8);
    /// Signal `WireVersion`.
    pub const WIRE_VERSION: Field = Field::unsigned(40, 8);
    /// Signal `Loads`.
    pub const LOADS: Field = Field::unsigned(48, 4);
    /// Signal `Sensors`.
    pub const SENSORS: Field = Field::unsigned(52, 4);
    /// Signal `LoadEvery`.
    pub const LOAD_EVERY: Field = Field::unsigned(56, 4);
    /// Signal `SensorEvery`.
    pub const SENSOR_EVERY: Field = Field::unsigned(60, 4);
    /// Signal `Tick`.
    pub const TICK: Field = Field::unsigned(32, 32);
    /// Signal `Rate`.
    pub const RATE: Field = Field::unsigned(32, 32);
}

/// `Load1`.
pub mod load {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 1;
    /// Signal `Crc`.
    pub const CRC: Field = Field::unsigned(0, 16);
    /// Signal `Counter`.
    pub const COUNTER: Field = Field::unsigned(16, 8);
    /// Signal `Value`.
    pub const VALUE: Field = Field::signed(24, 18);
    /// Signal `Std`.
    pub const STD: Field = Field::unsigned(42, 12);
    /// Signal `Fault`.
    pub const FAULT: Field = Field::unsigned(54, 5);
    /// Signal `Age`.
    pub const AGE: Field = Field::unsigned(59, 5);
}

/// `SensorHealth`.
pub mod sensor_health {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 7;
    /// Signal `Crc`.
    pub const CRC: Field = Field::unsigned(0, 16);
    /// Signal `Counter`.
    pub const COUNTER: Field = Field::unsigned(16, 8);
    /// Signal `Sensor`.
    pub const SENSOR: Field = Field::unsigned(24, 4);
    /// Signal `Homed`.
    pub const HOMED: Field = Field::unsigned(33, 1);
    /// Signal `SensorFault`.
    pub const SENSOR_FAULT: Field = Field::unsigned(28, 5);
    /// Signal `SensorInnovation`.
    pub const SENSOR_INNOVATION: Field = Field::signed(36, 12);
    /// Signal `SensorNis`.
    pub const SENSOR_NIS: Field = Field::unsigned(48, 16);
}

/// `RawHead`.
pub mod raw_head {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 8;
    /// Signal `SampleCrc`.
    pub const SAMPLE_CRC: Field = Field::unsigned(0, 16);
    /// Signal `Tick`.
    pub const TICK: Field = Field::unsigned(16, 32);
    /// Signal `Valid`.
    pub const VALID: Field = Field::unsigned(48, 10);
    /// Signal `HasIndex`.
    pub const HAS_INDEX: Field = Field::unsigned(63, 1);
}

/// `RawWords0`.
pub mod raw_words {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 9;
    /// Signal `Word0`.
    pub const WORD0: Field = Field::signed(0, 32);
    /// Signal `Word1`.
    pub const WORD1: Field = Field::signed(32, 32);
}

/// `RawEncoders`.
pub mod raw_encoders {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 13;
    /// Signal `Encoder0`.
    pub const ENCODER0: Field = Field::unsigned(0, 32);
    /// Signal `Encoder1`.
    pub const ENCODER1: Field = Field::unsigned(32, 32);
}

/// `RawIndex`.
pub mod raw_index {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 14;
    /// Signal `Latched`.
    pub const LATCHED: Field = Field::unsigned(0, 32);
}

/// `RawFd`.
pub mod raw_fd {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 15;
    /// Signal `Crc`.
    pub const CRC: Field = Field::unsigned(0, 16);
    /// Signal `Counter`.
    pub const COUNTER: Field = Field::unsigned(16, 8);
    /// Signal `Tick`.
    pub const TICK: Field = Field::unsigned(24, 32);
    /// Signal `Valid`.
    pub const VALID: Field = Field::unsigned(56, 10);
    /// Signal `HasIndex`.
    pub const HAS_INDEX: Field = Field::unsigned(71, 1);
    /// Signal `Word0`.
    pub const WORD0: Field = Field::signed(72, 32);
    /// Signal `Word1`.
    pub const WORD1: Field = Field::signed(104, 32);
    /// Signal `Word2`.
    pub const WORD2: Field = Field::signed(136, 32);
    /// Signal `Word3`.
    pub const WORD3: Field = Field::signed(168, 32);
    /// Signal `Word4`.
    pub const WORD4: Field = Field::signed(200, 32);
    /// Signal `Word5`.
    pub const WORD5: Field = Field::signed(232, 32);
    /// Signal `Word6`.
    pub const WORD6: Field = Field::signed(264, 32);
    /// Signal `Word7`.
    pub const WORD7: Field = Field::signed(296, 32);
    /// Signal `Encoder0`.
    pub const ENCODER0: Field = Field::unsigned(328, 32);
    /// Signal `Encoder1`.
    pub const ENCODER1: Field = Field::unsigned(360, 32);
    /// Signal `Latched`.
    pub const LATCHED: Field = Field::unsigned(392, 32);
}

/// `Board`.
pub mod board {
    use crate::io::frame::Field;

    /// Identifier, from the base.
    pub const OFFSET: u16 = 16;
    /// Signal `Crc`.
    pub const CRC: Field = Field::unsigned(0, 16);
    /// Signal `Counter`.
    pub const COUNTER: Field = Field::unsigned(16, 8);
    /// Signal `Page`.
    pub const PAGE: Field = Field::unsigned(24, 4);
    /// Signal `Major`.
    pub const MAJOR: Field = Field::unsigned(32, 8);
    /// Signal `Minor`.
    pub const MINOR: Field = Field::unsigned(40, 8);
    /// Signal `Patch`.
    pub const PATCH: Field = Field::unsigned(48, 8);
    /// Signal `RawSamples`.
    pub const RAW_SAMPLES: Field = Field::unsigned(32, 16);
    /// Signal `DroppedBursts`.
    pub const DROPPED_BURSTS: Field = Field::unsigned(48, 16);
}
