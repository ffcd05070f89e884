//! Cause and hint of a fault, as people and programs get them.

use std::fmt;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

/// Cause of a fault, with a hint if the cause itself does not say what to do. `Display` prints both in one sentence. Serialised fields:
/// `fault` (that sentence), `cause`, `hint`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Explained {
    /// Cause, without what to do.
    pub cause: String,
    /// Remedy for the cause.
    pub hint: Option<&'static str>,
}

impl fmt::Display for Explained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.cause)?;
        self.hint.map_or(Ok(()), |hint| write!(f, ": {hint}"))
    }
}

impl Serialize for Explained {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(None)?;
        fields.serialize_entry("fault", &self.to_string())?;
        fields.serialize_entry("cause", &self.cause)?;
        if let Some(hint) = self.hint {
            fields.serialize_entry("hint", hint)?;
        }
        fields.end()
    }
}

impl<T: Into<String>> From<T> for Explained {
    fn from(cause: T) -> Explained {
        Explained { cause: cause.into(), hint: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_one_sentence_and_programs_get_both_parts() {
        let refused =
            Explained { cause: "nothing listens there".to_owned(), hint: Some("is the port right?") };
        assert_eq!(refused.to_string(), "nothing listens there: is the port right?");
        let expected = r#"{"fault":"nothing listens there: is the port right?","cause":"nothing listens there","hint":"is the port right?"}"#;
        assert_eq!(serde_json::to_string(&refused).unwrap(), expected);
        let bare = Explained::from("broken");
        assert_eq!(serde_json::to_string(&bare).unwrap(), r#"{"fault":"broken","cause":"broken"}"#);
    }
}
