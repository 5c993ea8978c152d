//! Encodes what a board says of itself once a second, and decodes it (`BoardInfo`): the version of
//! its firmware, which of its raw samples it sends, and the bursts that it dropped.

use crate::io::frame::signal_layout::board as field;

/// Which raw samples a board sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RawOutput {
    /// None.
    #[default]
    None,
    /// Those of so many ticks after the start of the estimator, tick 0 the first; 1 to 65534.
    Burst(u16),
    /// All.
    All,
}

impl RawOutput {
    /// Code of `All`.
    const ALL: u32 = 0xFFFF;

    fn code(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Burst(samples) => u32::from(samples).min(Self::ALL - 1),
            Self::All => Self::ALL,
        }
    }

    fn of(code: u32) -> Self {
        match code {
            0 => Self::None,
            Self::ALL => Self::All,
            samples => Self::Burst(samples as u16),
        }
    }
}

/// Board information. The count of dropped bursts wraps in the board and saturates at 65535 on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardInfo {
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Which raw samples it sends since the estimator started.
    pub raw: RawOutput,
    /// Bursts of raw samples that were dropped: the bus did not carry them away as fast as they came.
    pub dropped_bursts: u32,
}

/// What one frame reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardPage {
    /// `firmware`.
    Firmware,
    /// `raw` and `dropped_bursts`.
    Raw,
}

impl BoardPage {
    const fn code(self) -> u32 {
        match self {
            Self::Firmware => 0,
            Self::Raw => 1,
        }
    }
}

impl BoardInfo {
    /// Payload of a page.
    pub(crate) fn encode(&self, page: BoardPage) -> u64 {
        let content = match page {
            BoardPage::Firmware => {
                let [major, minor, patch] = self.firmware.map(u32::from);
                field::MAJOR.put(major) | field::MINOR.put(minor) | field::PATCH.put(patch)
            }
            BoardPage::Raw => {
                field::RAW_SAMPLES.put(self.raw.code())
                    | field::DROPPED_BURSTS.put(self.dropped_bursts.min(u16::MAX.into()))
            }
        };
        field::PAGE.put(page.code()) | content
    }

    /// An information with the content of this page, and the page.
    pub(crate) fn decode(payload: u64) -> Option<(Self, BoardPage)> {
        let mut info = Self::default();
        let page = match field::PAGE.get(payload) {
            0 => {
                let version = [field::MAJOR, field::MINOR, field::PATCH];
                info.firmware = version.map(|field| field.get(payload) as u8);
                BoardPage::Firmware
            }
            1 => {
                info.raw = RawOutput::of(field::RAW_SAMPLES.get(payload));
                info.dropped_bursts = field::DROPPED_BURSTS.get(payload);
                BoardPage::Raw
            }
            _ => return None,
        };
        Some((info, page))
    }

    /// Takes over `page` of `newer`.
    pub fn merge(&mut self, newer: &Self, page: BoardPage) {
        match page {
            BoardPage::Firmware => self.firmware = newer.firmware,
            BoardPage::Raw => {
                self.raw = newer.raw;
                self.dropped_bursts = newer.dropped_bursts;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_pages_give_it_back() {
        for raw in [RawOutput::None, RawOutput::Burst(4000), RawOutput::All] {
            let info = BoardInfo {
                firmware: [1, 20, 255],
                raw,
                dropped_bursts: 70_000,
            };
            let mut result = BoardInfo::default();
            for page in [BoardPage::Firmware, BoardPage::Raw] {
                let (part, found) = BoardInfo::decode(info.encode(page)).expect("a page");
                assert_eq!(found, page);
                result.merge(&part, page);
            }
            let dropped_bursts = 65_535;
            assert_eq!(
                result,
                BoardInfo {
                    dropped_bursts,
                    ..info
                }
            );
        }
        assert_eq!(BoardInfo::decode(field::PAGE.put(2)), None);
    }
}
