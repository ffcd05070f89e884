//! `sha256` of a model: the SHA-256 of each of its files. A file that was changed later is rejected.
//!
//! ```toml
//! stand_ins = "spindle.stand-ins.json"
//! sha256.stand_ins = "9f86d081…"       # 64 hex digits, as `sha256sum spindle.stand-ins.json` prints them
//! ```
//! `isotherm identify` writes these keys. Files without such a key are not checked, because users write some of them by
//! hand.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::sha256;
use crate::tables::KeyContext;

/// Number of hex digits of a SHA-256.
const DIGITS: usize = 64;

/// SHA-256 of each file of the model.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sha256")]
pub(super) struct RawSeals {
    /// SHA-256 of `file`.
    file: Option<String>,
    /// SHA-256 of `envelope`.
    envelope: Option<String>,
    /// SHA-256 of `halves`.
    halves: Option<String>,
    /// SHA-256 of `stand_ins`.
    stand_ins: Option<String>,
}

impl RawSeals {
    /// Returns each key of a model that can contain the path of a file, with the SHA-256 that the profile states for
    /// the file. The SHA-256 is `None` if the profile does not state it.
    fn each(&self) -> [(&'static str, Option<&String>); 4] {
        [
            ("file", self.file.as_ref()),
            ("envelope", self.envelope.as_ref()),
            ("halves", self.halves.as_ref()),
            ("stand_ins", self.stand_ins.as_ref()),
        ]
    }

    /// Reports an invalid SHA-256, and a SHA-256 for which the model has no file. Warns about a file without a SHA-256
    /// if other files have one. `at` is the context of the model.
    pub(super) fn check(&self, files: [&Option<String>; 4], at: &KeyContext<'_>) {
        let place = at.key("sha256");
        for ((key, seal), named) in self.each().into_iter().zip(files) {
            match (seal, named) {
                (Some(_), None) => {
                    let help = format!("write the path of the file in `{key}`, or remove this SHA-256");
                    place.key(key).wrong_key(
                        format!("the model has a SHA-256 for the file `{key}`, but no key `{key}`"),
                        help,
                    );
                }
                (Some(seal), Some(name)) if !is_sha256(seal) => place.key(key).invalid(
                    format!("a SHA-256 has {DIGITS} hex digits"),
                    format!("write the digits that `sha256sum {name}` prints"),
                ),
                (None, Some(name)) if self.each().iter().any(|(_, seal)| seal.is_some()) => {
                    let message = format!(
                        "{name} has no `sha256.{key}`, but other files of the model have a SHA-256: a change \
                         of this file is not detected"
                    );
                    let help = format!("write sha256.{key} with the digits that `sha256sum {name}` prints");
                    at.key(key).warn(message, help);
                }
                _ => {}
            }
        }
    }

    /// Returns whether the profile states a SHA-256 for the file that this key names.
    #[cfg(feature = "onnx")]
    pub(super) fn states(&self, key: &str) -> bool {
        self.each().into_iter().any(|(own, seal)| own == key && seal.is_some())
    }

    /// Returns whether the bytes of a file have the SHA-256 that the profile states. If not, reports an error at the
    /// key that names the file. Without a stated SHA-256, returns `true`.
    pub(super) fn fits(&self, key: &str, at: &KeyContext<'_>, name: &str, bytes: &[u8]) -> bool {
        let seal = self.each().into_iter().find(|(own, _)| *own == key).and_then(|(_, seal)| seal);
        // An invalid seal has been reported.
        let Some(seal) = seal.filter(|seal| is_sha256(seal)) else { return true };
        let found = sha256(bytes);
        if found.eq_ignore_ascii_case(seal) {
            return true;
        }
        at.invalid(
            format!(
                "{name}: the file was changed, or belongs to another model: the SHA-256 of the file is not \
                 `sha256.{key}`"
            ),
            format!(
                "put back the file that `isotherm identify` wrote with this block, or paste the block that \
                 was written with this file. If the change is intended, write sha256.{key} = \"{found}\""
            ),
        );
        false
    }
}

fn is_sha256(text: &str) -> bool {
    text.len() == DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}
