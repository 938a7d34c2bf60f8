//! Binary data, and blocks of samples.

use std::fmt;

use serde::de::{self, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Payload of `tele/batch`: [seq, t, bin].
#[derive(Debug, Clone, PartialEq)]
pub struct TelemetryBlock {
    /// Number of the first row's cycle.
    pub seq: u64,
    /// Executor time of the first row [s].
    pub t: f64,
    /// float32, little endian, shape (rows, axes, fields) in C order.
    pub rows: Bytes,
}

/// Binary data.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Bytes(pub Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;

        impl Visitor<'_> for Reader {
            type Value = Bytes;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("binary data")
            }

            fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<Bytes, E> {
                Ok(Bytes(bytes.to_vec()))
            }

            fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<Bytes, E> {
                Ok(Bytes(bytes))
            }
        }

        deserializer.deserialize_byte_buf(Reader)
    }
}

impl<'de> Deserialize<'de> for TelemetryBlock {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader;

        impl<'de> Visitor<'de> for Reader {
            type Value = TelemetryBlock;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an array [seq, t, bin]")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<TelemetryBlock, A::Error> {
                let missing = |index| de::Error::invalid_length(index, &"[seq, t, bin]");
                let block = TelemetryBlock {
                    seq: elements.next_element()?.ok_or_else(|| missing(0))?,
                    t: elements.next_element()?.ok_or_else(|| missing(1))?,
                    rows: elements.next_element()?.ok_or_else(|| missing(2))?,
                };
                // what a later version adds
                while elements.next_element::<IgnoredAny>()?.is_some() {}
                Ok(block)
            }
        }

        deserializer.deserialize_seq(Reader)
    }
}
