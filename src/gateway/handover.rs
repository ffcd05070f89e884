//! What a gateway hands to the program that takes its place in the same process: which axes were armed, so that they go on
//! as they were.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::core::Core;

/// What the one says to the other.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Handover {
    /// Who wanted it, as it stands in a sentence.
    pub by: String,
    /// The axes that were armed.
    pub armed: Vec<String>,
    /// Those that were switched off, and why: only a person arms them.
    pub off: BTreeMap<String, String>,
}

impl Handover {
    pub(super) fn of(core: &Core, by: String) -> Handover {
        let mut handover = Handover { by, ..Handover::default() };
        for (axis, arming) in core.given.profile.axes.iter().zip(core.arming.as_slice()) {
            let name = axis.settings.name.clone();
            if arming.armed && !arming.tripped {
                handover.armed.push(name);
            } else if arming.latched || arming.tripped {
                handover.off.insert(name, arming.why.clone());
            }
        }
        handover
    }
}
