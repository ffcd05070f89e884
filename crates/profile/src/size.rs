//! Sizes of disk space, as a profile states them: "500MB", "2GB".

use serde::{Deserialize, Deserializer};

use crate::schema_of::schema_of;

/// Number of bytes, as written in a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size(pub(crate) u64);

/// Units of a size, each with its number of bytes. They are decimal, as for the capacity of disks.
const UNITS: [(&str, u64); 3] = [("MB", 1_000_000), ("GB", 1_000_000_000), ("TB", 1_000_000_000_000)];

impl Size {
    fn parse(text: &str) -> Option<u64> {
        let text = text.trim();
        let (unit, bytes) = UNITS.into_iter().find(|(unit, _)| text.ends_with(unit))?;
        text.strip_suffix(unit)?.trim().parse::<u64>().ok()?.checked_mul(bytes)
    }
}

impl<'de> Deserialize<'de> for Size {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Size, D::Error> {
        let text = String::deserialize(deserializer)?;
        let wrong = || {
            serde::de::Error::custom(format!("`{text}` is not a size; write a size as \"500MB\" or \"2GB\""))
        };
        Size::parse(&text).map(Size).ok_or_else(wrong)
    }
}

schema_of!(Size as "Size": {
    "description": "A size on disk with its unit, as \"500MB\" or \"2GB\".",
    "type": "string",
    "pattern": "^\\s*\\d+\\s*(MB|GB|TB)\\s*$",
    "examples": ["500MB", "2GB"],
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_a_whole_number_with_its_unit() {
        for (text, size) in [
            ("2GB", Some(2_000_000_000)),
            (" 500 MB ", Some(500_000_000)),
            ("1TB", Some(1_000_000_000_000)),
            ("2", None),
            ("GB", None),
            ("-2GB", None),
            ("2gb", None),
            ("1.5GB", None),
            ("99999999999TB", None),
        ] {
            assert_eq!(Size::parse(text), size, "{text}");
        }
    }
}
