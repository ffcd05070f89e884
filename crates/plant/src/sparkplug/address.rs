//! MQTT topics of an edge node: `spBv1.0/GROUP/VERB/NODE`.

/// First level of every topic of Sparkplug B.
const NAMESPACE: &str = "spBv1.0";

/// Address of an edge node: the names of its group and of the node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    group: String,
    node: String,
}

/// Second level of the topics on which hosts publish their own state.
const STATE: &str = "STATE";

/// Kinds of messages that an edge node without devices sends or receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// NBIRTH: all metrics with their current values.
    Birth,
    /// NDATA: metrics that have changed.
    Data,
    /// NDEATH: the node is offline.
    Death,
    /// NCMD: a command from a host.
    Command,
}

impl Address {
    /// Creates the address of an edge node from the names of its group and node.
    ///
    /// # Errors
    /// The group or the node contains a character that MQTT does not allow in a topic. The error message contains this
    /// character.
    pub fn new(group: &str, node: &str) -> Result<Address, String> {
        is_level("group", group)?;
        is_level("node", node)?;
        if group == STATE {
            return Err(
                "the group of Sparkplug B cannot be `STATE`: hosts publish their own state under this name"
                    .to_owned(),
            );
        }
        Ok(Address { group: group.to_owned(), node: node.to_owned() })
    }

    /// Returns the topic on which the host of this name publishes its own state.
    ///
    /// # Errors
    /// The name contains a character that MQTT does not allow in a topic. The error message contains this character.
    pub fn state_topic(host: &str) -> Result<String, String> {
        is_level("primary host", host)?;
        Ok(format!("{NAMESPACE}/{STATE}/{host}"))
    }

    /// Returns the topic for messages of this kind.
    pub fn topic(&self, verb: Verb) -> String {
        format!("{NAMESPACE}/{}/{}/{}", self.group, verb.word(), self.node)
    }
}

/// Checks that a name can be one level of a topic. `what` is the subject of the error message: the group or the node.
fn is_level(what: &str, name: &str) -> Result<(), String> {
    if name.is_empty() {
        return Err(format!("the name of the {what} of Sparkplug B is empty"));
    }
    match name.chars().find(|c| matches!(c, '+' | '/' | '#') || c.is_control()) {
        None => Ok(()),
        Some(c) => Err(format!(
            "the {what} of Sparkplug B cannot be `{}`: {c:?} has a special meaning in topics of MQTT",
            name.escape_debug()
        )),
    }
}

impl Verb {
    fn word(self) -> &'static str {
        match self {
            Verb::Birth => "NBIRTH",
            Verb::Data => "NDATA",
            Verb::Death => "NDEATH",
            Verb::Command => "NCMD",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_names_group_kind_and_node() {
        let address = Address::new("Plant 1", "grinder-3").unwrap();
        let topics = [Verb::Birth, Verb::Data, Verb::Death, Verb::Command].map(|verb| address.topic(verb));
        let expected =
            ["NBIRTH", "NDATA", "NDEATH", "NCMD"].map(|verb| format!("spBv1.0/Plant 1/{verb}/grinder-3"));
        assert_eq!(topics, expected);
    }

    #[test]
    fn the_state_of_a_host_has_a_topic_of_its_own() {
        assert_eq!(Address::state_topic("SCADA 1"), Ok("spBv1.0/STATE/SCADA 1".to_owned()));
        for host in ["", "a/b", "a+", "#"] {
            let why = Address::state_topic(host).unwrap_err();
            assert!(why.contains("the primary host of Sparkplug B"), "{why}");
        }
    }

    #[test]
    fn a_name_that_would_be_more_than_one_level_of_a_topic_is_refused_with_its_letter() {
        let table = [
            ("", "n", "the name of the group of Sparkplug B is empty"),
            ("g", "", "the name of the node of Sparkplug B is empty"),
            (
                "g/h",
                "n",
                "the group of Sparkplug B cannot be `g/h`: '/' has a special meaning in topics of MQTT",
            ),
            (
                "g",
                "n+",
                "the node of Sparkplug B cannot be `n+`: '+' has a special meaning in topics of MQTT",
            ),
            ("g", "#", "the node of Sparkplug B cannot be `#`: '#' has a special meaning in topics of MQTT"),
            (
                "g",
                "a\0",
                "the node of Sparkplug B cannot be `a\\0`: '\\0' has a special meaning in topics of MQTT",
            ),
            (
                "STATE",
                "n",
                "the group of Sparkplug B cannot be `STATE`: hosts publish their own state under this name",
            ),
        ];
        for (group, node, why) in table {
            assert_eq!(Address::new(group, node), Err(why.to_owned()), "{group} {node}");
        }
    }
}
