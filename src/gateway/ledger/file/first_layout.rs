//! The first layout of the ledger's file: accounts of shared registers alone, in counts without the bias, promises as
//! shares. What it says is taken over.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::{Entries, Entry};
use isotherm_core::output::{Account, Doubt, Kept, MOST_UNDER_WAY, Promise, Slots};
use isotherm_core::quantity::{Counts, Moment};

#[derive(Deserialize)]
struct Version {
    version: u32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Former {
    #[serde(rename = "version")]
    _version: u32,
    outputs: BTreeMap<String, FormerAccount>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FormerAccount {
    register: String,
    base: Counts,
    share: Counts,
    promised: Vec<Counts>,
    doubt: Option<String>,
}

/// What a file of the first layout says; `None` where it is none.
pub(super) fn read(text: &str) -> Option<Result<Entries, String>> {
    serde_json::from_str::<Version>(text).ok().filter(|version| version.version == 1)?;
    let former: Result<Former, _> = serde_json::from_str(text);
    Some(former.map_err(|error| error.to_string()).and_then(|former| {
        former.outputs.into_iter().map(|(name, account)| Ok((name, entry(account)?))).collect()
    }))
}

fn entry(former: FormerAccount) -> Result<Entry, String> {
    let FormerAccount { register, base, share, promised, doubt } = former;
    let bias: Counts =
        register.rsplit(' ').next().and_then(|bias| bias.parse().ok()).map_or(Counts::ZERO, Counts);
    let base = base + bias;
    let doubt = doubt.map(|doubt| match doubt.as_str() {
        "undecidable" => Doubt::ChangedMeanwhile,
        "rebooted" => Doubt::Rebooted,
        "unsteady" => Doubt::Unsteady,
        "lost" => Doubt::Lost,
        "elsewhere" => Doubt::Elsewhere,
        _ => Doubt::Unreadable,
    });
    if promised.len() > MOST_UNDER_WAY {
        return Err("it promises more than is ever promised at a time".to_owned());
    }
    let mut promises = Slots::default();
    for share in promised {
        let value = base + share;
        let _ = promises.push(Promise { value, at: Moment::default(), is_under_way: true });
    }
    let account = Some(Account { base, share, doubt });
    Ok(Entry { register, kept: Kept { account, promises, ..Kept::default() } })
}
