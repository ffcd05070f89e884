//! JSON schemas of status fields whose JSON form differs from their Rust type.

use schemars::{Schema, SchemaGenerator, json_schema};

/// Schema of the displayed state of an axis.
pub(super) fn shown(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "type": "object",
        "properties": {
            "shown": {
                "type": "string",
                "description": "Displayed state: one of the states in `state`, or unmodelled, sign-check or unreachable.",
            },
            "tone": { "type": "string", "enum": ["good", "warn", "bad", "off"], "description": "Severity of the state." },
        },
        "required": ["shown", "tone"],
    })
}

/// Schema of an explanation: one sentence (`why`), and its parts `cause` and `hint`.
pub(super) fn in_parts(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "type": "object",
        "properties": {
            "why": {
                "type": "string",
                "description": "Condition for which the axis waits, or reason why the preferred model cannot be used. Empty if there is none.",
            },
            "cause": { "type": "string", "description": "First part of `why`. Missing if `why` is empty." },
            "hint": { "type": "string", "description": "Second part of `why`: the remedy. Missing if there is none." },
        },
        "required": ["why"],
    })
}
