//! CDR, the bytes of ROS 2 messages: four bytes that say the byte order, then each number aligned to
//! its own size, counted from behind those four (OMG DDS-XTypes, XCDR version 1).

/// Why bytes are not the CDR that was expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message ends within a field.
    #[error("the message ends within its field `{0}`")]
    Truncated(&'static str),
    /// Another representation than plain CDR.
    #[error("its bytes are in the representation {0:#06x}{name}; expected plain CDR (0x0000 or 0x0001)", name = name_of(*.0))]
    Representation(u16),
    /// A string that is not UTF-8 or lacks its terminating zero.
    #[error("its field `{0}` is not a string")]
    NotAString(&'static str),
}

/// The name of a representation, in brackets (OMG DDS-XTypes 1.3, table 60).
fn name_of(representation: u16) -> &'static str {
    match representation {
        2 | 3 => " (PL_CDR, a parameter list)",
        6 | 7 => " (CDR2)",
        8 | 9 => " (D_CDR2)",
        10 | 11 => " (PL_CDR2, a parameter list)",
        _ => "",
    }
}

/// Reads the fields of a message in their order.
pub(super) struct Decoder<'a> {
    body: &'a [u8],
    position: usize,
    big_endian: bool,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(message: &'a [u8]) -> Result<Self, CdrError> {
        let (&head, body) = message.split_first_chunk::<4>().ok_or(CdrError::Truncated("representation"))?;
        match head {
            [0, kind @ (0 | 1), _, _] => Ok(Self { body, position: 0, big_endian: kind == 0 }),
            [high, low, ..] => Err(CdrError::Representation(u16::from_be_bytes([high, low]))),
        }
    }

    fn take(&mut self, len: usize, align: usize, field: &'static str) -> Result<&'a [u8], CdrError> {
        let start = self.position.next_multiple_of(align);
        let end = start.checked_add(len).ok_or(CdrError::Truncated(field))?;
        let bytes = self.body.get(start..end).ok_or(CdrError::Truncated(field))?;
        self.position = end;
        Ok(bytes)
    }

    fn number<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], CdrError> {
        let mut bytes: [u8; N] = self.take(N, N, field)?.try_into().expect("take returns N bytes");
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub(super) fn u8(&mut self, field: &'static str) -> Result<u8, CdrError> {
        self.number(field).map(u8::from_le_bytes)
    }

    pub(super) fn u32(&mut self, field: &'static str) -> Result<u32, CdrError> {
        self.number(field).map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self, field: &'static str) -> Result<i32, CdrError> {
        self.number(field).map(i32::from_le_bytes)
    }

    pub(super) fn f64(&mut self, field: &'static str) -> Result<f64, CdrError> {
        self.number(field).map(f64::from_le_bytes)
    }

    pub(super) fn f64_array<const N: usize>(&mut self, field: &'static str) -> Result<[f64; N], CdrError> {
        let mut array = [0.0; N];
        for number in &mut array {
            *number = self.f64(field)?;
        }
        Ok(array)
    }

    /// A sequence; its stated length is believed only as far as there are bytes.
    pub(super) fn f64_sequence(&mut self, field: &'static str) -> Result<Vec<f64>, CdrError> {
        let count = self.u32(field)? as usize;
        if count > self.body.len() / size_of::<f64>() {
            return Err(CdrError::Truncated(field));
        }
        (0..count).map(|_| self.f64(field)).collect()
    }

    pub(super) fn bytes(&mut self, field: &'static str) -> Result<&'a [u8], CdrError> {
        let len = self.u32(field)? as usize;
        self.take(len, 1, field)
    }

    pub(super) fn string(&mut self, field: &'static str) -> Result<&'a str, CdrError> {
        match self.bytes(field)? {
            // Some writers leave the zero of an empty string away.
            [] => Ok(""),
            [text @ .., 0] => std::str::from_utf8(text).map_err(|_| CdrError::NotAString(field)),
            _ => Err(CdrError::NotAString(field)),
        }
    }
}

/// Writes the fields of a message in their order, little-endian.
pub(super) struct Encoder(Vec<u8>);

/// Length of what says the byte order.
const HEAD_LEN: usize = 4;

impl Encoder {
    pub(super) fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.0.resize(HEAD_LEN + (self.0.len() - HEAD_LEN).next_multiple_of(N), 0);
        self.0.extend(bytes);
    }

    pub(super) fn u8(&mut self, number: u8) {
        self.number(number.to_le_bytes());
    }

    pub(super) fn u32(&mut self, number: u32) {
        self.number(number.to_le_bytes());
    }

    pub(super) fn i32(&mut self, number: i32) {
        self.number(number.to_le_bytes());
    }

    pub(super) fn f64(&mut self, number: f64) {
        self.number(number.to_le_bytes());
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
    }

    pub(super) fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message() -> Vec<u8> {
        let mut encoder = Encoder::new();
        encoder.u8(7);
        encoder.u32(8);
        encoder.string("blade");
        encoder.f64(-2.5);
        encoder.bytes(&[1, 2, 3]);
        encoder.i32(-4);
        encoder.finish()
    }

    fn decode(message: &[u8]) -> Result<(), CdrError> {
        let mut decoder = Decoder::new(message)?;
        assert_eq!(decoder.u8("a")?, 7);
        assert_eq!(decoder.u32("b")?, 8);
        assert_eq!(decoder.string("c")?, "blade");
        assert_eq!(decoder.f64("d")?, -2.5);
        assert_eq!(decoder.bytes("e")?, [1, 2, 3]);
        assert_eq!(decoder.i32("f")?, -4);
        Ok(())
    }

    #[test]
    fn what_is_written_is_read() {
        assert_eq!(decode(&message()), Ok(()));
    }

    #[test]
    fn a_message_cut_anywhere_is_truncated() {
        let message = message();
        for len in 0..message.len() {
            assert!(matches!(decode(&message[..len]), Err(CdrError::Truncated(_))), "{len}");
        }
    }

    #[test]
    fn big_endian_is_read() {
        let message = [0, 0, 0, 0, 1, 0, 0, 0, 0x12, 0x34, 0x56, 0x78];
        let mut decoder = Decoder::new(&message).expect("plain CDR");
        assert_eq!(decoder.u8("a"), Ok(1));
        assert_eq!(decoder.u32("b"), Ok(0x1234_5678));
    }

    #[test]
    fn a_hostile_length_does_not_allocate() {
        let message = [0, 1, 0, 0, 255, 255, 255, 255];
        let decoder = || Decoder::new(&message).expect("plain CDR");
        assert_eq!(decoder().f64_sequence("d"), Err(CdrError::Truncated("d")));
        assert_eq!(decoder().bytes("d"), Err(CdrError::Truncated("d")));
        assert_eq!(decoder().string("d"), Err(CdrError::Truncated("d")));
    }

    #[test]
    fn another_representation_is_named() {
        assert_eq!(Decoder::new(&[0, 7, 0, 0]).err(), Some(CdrError::Representation(7)));
        let error = Decoder::new(&[0, 3, 0, 0]).err().expect("a parameter list");
        assert_eq!(
            error.to_string(),
            "its bytes are in the representation 0x0003 (PL_CDR, a parameter list); expected plain CDR (0x0000 or 0x0001)"
        );
    }
}
