//! What the records of an MCAP file say.

pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 0x01;
    pub(in super::super) const FOOTER: u8 = 0x02;
    pub(in super::super) const SCHEMA: u8 = 0x03;
    pub(in super::super) const CHANNEL: u8 = 0x04;
    pub(in super::super) const MESSAGE: u8 = 0x05;
    pub(in super::super) const CHUNK: u8 = 0x06;
    pub(in super::super) const ATTACHMENT: u8 = 0x09;
    pub(in super::super) const STATISTICS: u8 = 0x0b;
    pub(in super::super) const METADATA: u8 = 0x0c;
    pub(in super::super) const METADATA_INDEX: u8 = 0x0d;
    pub(in super::super) const DATA_END: u8 = 0x0f;
}

/// Longest message that is read: an image of 1280×1024 has 5 MB. Longer ones are passed over.
pub(super) const MAX_RECORD_LEN: u64 = 64 << 20;
/// Longest record of another kind that is read.
const MAX_OTHER_LEN: u64 = 1 << 20;

/// A record that matters here; all others are passed over.
#[derive(Debug, PartialEq)]
pub(in crate::recording) enum Record<'a> {
    Header {
        profile: &'a str,
    },
    Schema {
        id: u16,
        name: &'a str,
        encoding: &'a str,
        data: &'a [u8],
    },
    Channel {
        id: u16,
        schema: u16,
        topic: &'a str,
        message_encoding: &'a str,
        metadata: Vec<(&'a str, &'a str)>,
    },
    Message {
        channel: u16,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &'a [u8],
    },
    Attachment {
        log_time: u64,
        create_time: u64,
        name: &'a str,
        media_type: &'a str,
        data: &'a [u8],
    },
    Metadata {
        name: &'a str,
        entries: Vec<(&'a str, &'a str)>,
    },
    MetadataIndex {
        offset: u64,
        name: &'a str,
    },
    Statistics {
        message_counts: Vec<(u16, u64)>,
    },
}

/// Whether a record is read.
pub(super) fn matters(opcode: u8, len: u64) -> bool {
    match opcode {
        op::MESSAGE | op::ATTACHMENT => len <= MAX_RECORD_LEN,
        op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA | op::METADATA_INDEX | op::STATISTICS => {
            len <= MAX_OTHER_LEN
        }
        _ => false,
    }
}

/// A record from its bytes; `None` when they do not fit.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    let mut fields = Fields(body);
    Some(match opcode {
        op::HEADER => Record::Header { profile: fields.string()? },
        op::SCHEMA => Record::Schema {
            id: fields.u16()?,
            name: fields.string()?,
            encoding: fields.string()?,
            data: fields.bytes()?,
        },
        op::CHANNEL => Record::Channel {
            id: fields.u16()?,
            schema: fields.u16()?,
            topic: fields.string()?,
            message_encoding: fields.string()?,
            metadata: fields.string_map()?,
        },
        op::MESSAGE => Record::Message {
            channel: fields.u16()?,
            sequence: fields.u32()?,
            log_time: fields.u64()?,
            publish_time: fields.u64()?,
            data: fields.0,
        },
        op::ATTACHMENT => Record::Attachment {
            log_time: fields.u64()?,
            create_time: fields.u64()?,
            name: fields.string()?,
            media_type: fields.string()?,
            data: {
                let len = usize::try_from(fields.u64()?).ok()?;
                fields.take(len)?
            },
        },
        op::METADATA => Record::Metadata { name: fields.string()?, entries: fields.string_map()? },
        op::METADATA_INDEX => {
            let (offset, _len) = (fields.u64()?, fields.u64()?);
            Record::MetadataIndex { offset, name: fields.string()? }
        }
        op::STATISTICS => {
            // message_count u64; schemas u16; channels, attachments, metadata, chunks u32; first and
            // last time u64.
            fields.take(8 + 2 + 4 * 4 + 2 * 8)?;
            let mut map = Fields(fields.bytes()?);
            let mut message_counts = Vec::new();
            while !map.0.is_empty() {
                message_counts.push((map.u16()?, map.u64()?));
            }
            Record::Statistics { message_counts }
        }
        _ => return None,
    })
}

/// The fields of a record, little-endian, in their order; `None` behind the end.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    pub(super) fn bytes(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()?;
        self.take(len as usize)
    }

    fn string(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    fn string_map(&mut self) -> Option<Vec<(&'a str, &'a str)>> {
        let mut map = Fields(self.bytes()?);
        let mut entries = Vec::new();
        while !map.0.is_empty() {
            entries.push((map.string()?, map.string()?));
        }
        Some(entries)
    }
}
