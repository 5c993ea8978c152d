//! Constants of the image upload by the UDS download services (ISO 14229-1) over ISO-TP, and of the
//! request for raw samples: CAN identifiers, services, response codes.
//!
//! | request                                       | answer              |
//! |-----------------------------------------------|---------------------|
//! | `34 00 44 address[4] size[4]` request download | `74 20 block[2]`    |
//! | `36 counter data` transfer data               | `76 counter`        |
//! | `37` request transfer exit                    | `77`                |
//! | `31 01 02 00 samples[2] share` start routine  | `71 01 02 00`       |
//! | `22 02 00` read layout of kept counts         | `62 02 00 areas size[2]` |
//! | `23 14 address[4] size` read kept counts      | `63 data`           |
//!
//! Big endian. The routine sends a burst of raw samples, 1 to 65534; share of the bus (%) in bits 0
//! to 6, as FD frames with bit 7. Kept counts are in areas of `size` KiB, one behind the other from
//! address 0 on; a request reads 1 to 240 bytes, and a byte that cannot be read is 0. In an upload
//! the address is 0, the size that of the sealed image. `block` is the longest transfer request
//! with its two leading bytes; every block but the last is that long.
//! The counter starts at 1 and wraps from 255 to 0. A refused request is answered `7F service code`;
//! code 0x78 means "still at work". What is wrong with an image comes as
//! [`ImageError::code`](crate::io::signed_image::ImageError::code).

/// CAN identifier of requests to the board: the diagnostic standard's first
/// physical address, so that common tools find it.
pub const REQUEST_ID: u16 = 0x7E0;
/// CAN identifier of the board's answers.
pub const ANSWER_ID: u16 = 0x7E8;

/// Service: announces an image.
pub const REQUEST_DOWNLOAD: u8 = 0x34;
/// Service: carries a block of it.
pub const TRANSFER_DATA: u8 = 0x36;
/// Service: ends the transfer; the answer accepts or refuses the image.
pub const TRANSFER_EXIT: u8 = 0x37;

/// Service: starts a routine.
pub const ROUTINE_CONTROL: u8 = 0x31;
/// The start of a request for a burst of raw samples: start the first routine of the range that the
/// standard leaves to makers.
pub const BURST_ROUTINE: [u8; 4] = [ROUTINE_CONTROL, 0x01, 0x02, 0x00];

/// Service: reads a value by its identifier.
pub const READ_DATA: u8 = 0x22;
/// The request for the layout of kept counts.
pub const COUNTS_LAYOUT: [u8; 3] = [READ_DATA, 0x02, 0x00];
/// Bytes in the unit of the layout of kept counts.
pub const LAYOUT_UNIT: u32 = 1024;
/// Service: reads memory, that of kept counts.
pub const READ_MEMORY: u8 = 0x23;
/// The start of a request to read memory: an address of four bytes, a size of one.
pub const READ_FORMAT: [u8; 2] = [READ_MEMORY, 0x14];
/// Most bytes of one request to read memory.
pub const MOST_READ: u8 = 240;

/// A positive answer starts with the service plus this.
pub const POSITIVE: u8 = 0x40;
/// A negative answer starts with this.
pub const NEGATIVE: u8 = 0x7F;

/// Negative response code: no such service.
pub const SERVICE_NOT_SUPPORTED: u8 = 0x11;
/// Negative response code: the request's length or format is wrong.
pub const INCORRECT_LENGTH: u8 = 0x13;
/// Negative response code: another upload is under way; ask again.
pub const BUSY: u8 = 0x21;
/// Negative response code: not now, another request has to come first.
pub const SEQUENCE_ERROR: u8 = 0x24;
/// Negative response code: a parameter is out of range.
pub const OUT_OF_RANGE: u8 = 0x31;
/// Negative response code: the block is not the next one.
pub const WRONG_BLOCK_COUNTER: u8 = 0x73;
/// Negative response code: received, the answer follows.
pub const PENDING: u8 = 0x78;

/// The start of a request to download: no compression or encryption, address
/// and size of four bytes each, address 0.
pub const DOWNLOAD_FORMAT: [u8; 7] = [REQUEST_DOWNLOAD, 0x00, 0x44, 0, 0, 0, 0];
