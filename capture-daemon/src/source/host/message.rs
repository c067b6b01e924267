//! What a sensor process tells the daemon: one message a packet, with a sealed memfd where it has much to tell.

use std::os::fd::{AsFd, OwnedFd};

use common::sealed::{SealedBytes, SealedError, seal};

use crate::frame::{CameraModel, DepthFrame, MAX_PIXELS};

/// Longest message, bytes, without what is in a memfd.
pub(super) const MAX_BYTES: usize = 2048;
/// Most bytes of a list of devices.
const MAX_LIST: u64 = 1 << 20;
/// Bytes of a frame's message: columns, rows, time, unit and camera, 8 each.
const FRAME_BYTES: usize = 8 * 8;

/// What a sensor process tells.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Message {
    /// It is open, and is this.
    Opened(String),
    /// Its serial number.
    Serial(String),
    /// A frame.
    Frame(DepthFrame),
    /// A frame cannot be used, for this reason.
    Bad(String),
    /// So many frames were lost before they came here.
    Lost(u64),
    /// There is no such sensor; it is waited for.
    Missing(String),
    /// The devices there are, as JSON.
    Devices(String),
    /// The recording is over.
    End,
    /// It cannot go on, for this reason.
    Failed(String),
}

/// Why a packet is no message.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MessageError {
    /// Its bytes mean nothing.
    #[error("the sensor process sent a message of kind {kind} with {bytes} bytes, which is none")]
    Unknown {
        /// Its first byte.
        kind: u8,
        /// How many it has.
        bytes: usize,
    },
    /// Its memfd cannot be used.
    #[error("what the sensor process sent cannot be used: {0}")]
    Memory(#[from] SealedError),
    /// A frame whose numbers cannot be.
    #[error(
        "the sensor process sent a frame of {width}x{height} px with {found} bytes, expected up to {MAX_PIXELS} pixels of 2 bytes and a camera"
    )]
    Frame {
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// Bytes that came.
        found: usize,
    },
}

/// Cut so that it fits, in whole characters.
fn short(text: &str) -> &str {
    let ends = text.char_indices().map(|(at, c)| at + c.len_utf8());
    &text[..ends.take_while(|end| *end < MAX_BYTES).last().unwrap_or(0)]
}

impl Message {
    fn kind(&self) -> u8 {
        match self {
            Self::Opened(_) => b'o',
            Self::Serial(_) => b's',
            Self::Frame(_) => b'f',
            Self::Bad(_) => b'b',
            Self::Lost(_) => b'l',
            Self::Missing(_) => b'm',
            Self::Devices(_) => b'd',
            Self::End => b'e',
            Self::Failed(_) => b'x',
        }
    }

    /// The packet, and the memfd that goes with it.
    pub(super) fn to_packet(&self) -> Result<(Vec<u8>, Option<OwnedFd>), SealedError> {
        let mut packet = vec![self.kind()];
        let mut memory = None;
        match self {
            Self::Opened(text)
            | Self::Serial(text)
            | Self::Bad(text)
            | Self::Missing(text)
            | Self::Failed(text) => {
                packet.extend_from_slice(short(text).as_bytes());
            }
            Self::Lost(frames) => packet.extend_from_slice(&frames.to_le_bytes()),
            Self::Devices(list) => memory = Some(seal("sward-devices", list.as_bytes())?),
            Self::Frame(frame) => {
                let CameraModel { fx, fy, cx, cy } = frame.camera;
                let numbers = [frame.width as u64, frame.height as u64, frame.timestamp_ns];
                packet.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
                packet.extend(
                    [frame.depth_unit_m, fx, fy, cx, cy].iter().flat_map(|number| number.to_le_bytes()),
                );
                memory = Some(seal("sward-frame", bytemuck::cast_slice(&frame.depth))?);
            }
            Self::End => {}
        }
        Ok((packet, memory))
    }

    /// The message of a packet and its memfd.
    pub(super) fn of_packet(packet: &[u8], memory: Option<impl AsFd>) -> Result<Self, MessageError> {
        let unknown =
            || MessageError::Unknown { kind: packet.first().copied().unwrap_or(0), bytes: packet.len() };
        let (kind, rest) = packet.split_first().ok_or_else(unknown)?;
        let text = || String::from_utf8_lossy(rest).into_owned();
        Ok(match (kind, memory) {
            (b'o', None) => Self::Opened(text()),
            (b's', None) => Self::Serial(text()),
            (b'b', None) => Self::Bad(text()),
            (b'm', None) => Self::Missing(text()),
            (b'x', None) => Self::Failed(text()),
            (b'e', None) if rest.is_empty() => Self::End,
            (b'l', None) => Self::Lost(u64::from_le_bytes(rest.try_into().map_err(|_| unknown())?)),
            (b'd', Some(memory)) => {
                let list = SealedBytes::map(memory, MAX_LIST)?;
                Self::Devices(String::from_utf8_lossy(list.as_ref()).into_owned())
            }
            (b'f', Some(memory)) => {
                let numbers: &[u8; FRAME_BYTES] = rest.try_into().map_err(|_| unknown())?;
                Self::Frame(frame_of(numbers, &SealedBytes::map(memory, 2 * MAX_PIXELS as u64)?)?)
            }
            _ => return Err(unknown()),
        })
    }
}

fn frame_of(numbers: &[u8; FRAME_BYTES], pixels: &SealedBytes) -> Result<DepthFrame, MessageError> {
    let bytes = |index: usize| -> [u8; 8] { std::array::from_fn(|byte| numbers[8 * index + byte]) };
    let [width, height, timestamp_ns] = [0, 1, 2].map(|index| u64::from_le_bytes(bytes(index)));
    let [depth_unit_m, fx, fy, cx, cy] = [3, 4, 5, 6, 7].map(|index| f64::from_le_bytes(bytes(index)));
    let camera = CameraModel { fx, fy, cx, cy };
    let found = pixels.as_ref().len();
    let fits = width
        .checked_mul(height)
        .is_some_and(|all| (1..=MAX_PIXELS as u64).contains(&all) && 2 * all == found as u64);
    if !fits || !camera.is_valid() || !(1e-6..=0.1).contains(&depth_unit_m) {
        return Err(MessageError::Frame { width, height, found });
    }
    Ok(DepthFrame {
        width: width as usize,
        height: height as usize,
        depth: bytemuck::pod_collect_to_vec(pixels.as_ref()),
        depth_unit_m,
        timestamp_ns,
        camera,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> DepthFrame {
        DepthFrame {
            width: 3,
            height: 2,
            depth: vec![0, 1, 500, 65535, 7, 8],
            depth_unit_m: 0.0001,
            timestamp_ns: 1_700_000_000_123_456_789,
            camera: CameraModel { fx: 570.123, fy: 569.0, cx: 1.0, cy: 0.5 },
        }
    }

    fn there_and_back(message: &Message) -> Result<Message, MessageError> {
        let (packet, memory) = message.to_packet().expect("memory");
        assert!(packet.len() <= MAX_BYTES);
        Message::of_packet(&packet, memory)
    }

    #[test]
    fn messages_come_back_as_they_were() {
        let text = || "Größe 640x480".to_owned();
        let messages = [
            Message::Opened(text()),
            Message::Serial(text()),
            Message::Frame(frame()),
            Message::Bad(text()),
            Message::Lost(17),
            Message::Missing(text()),
            Message::Devices("[]".to_owned()),
            Message::End,
            Message::Failed(text()),
        ];
        for message in messages {
            assert_eq!(there_and_back(&message).expect("a message"), message);
        }
        let cut = there_and_back(&Message::Failed("ö".repeat(5000))).expect("a message");
        assert!(matches!(cut, Message::Failed(text) if text.chars().all(|c| c == 'ö') && text.len() > 2000));
    }

    #[test]
    fn what_is_no_message_is_refused() {
        assert!(Message::of_packet(&[], None::<OwnedFd>).is_err());
        assert!(Message::of_packet(b"?", None::<OwnedFd>).is_err());
        assert!(Message::of_packet(b"l123", None::<OwnedFd>).is_err());
        let (packet, memory) = Message::Frame(frame()).to_packet().expect("memory");
        assert!(Message::of_packet(&packet, None::<OwnedFd>).is_err(), "a frame without its pixels");
        assert!(Message::of_packet(&packet[..60], memory.as_ref()).is_err(), "cut short");
        for (index, byte) in [(1, 4), (3, 1), (24, 0x7f), (39, 0xff)] {
            let mut other = packet.clone();
            other[index] = byte;
            if index == 39 {
                other[33..41].copy_from_slice(&f64::NAN.to_le_bytes());
            }
            if index == 24 {
                other[25..33].copy_from_slice(&0f64.to_le_bytes());
            }
            assert!(Message::of_packet(&other, memory.as_ref()).is_err(), "byte {index}");
        }
    }
}
