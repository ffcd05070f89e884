//! What the page says, in each language that it speaks: one file each, and the same keys in all of them.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// The words of one language, by key.
pub(in crate::observe) struct Words {
    /// As `lang` and `Accept-Language` have it.
    pub(super) language: &'static str,
    /// The file: what the page's scripts read.
    pub(super) json: &'static str,
    by_key: BTreeMap<String, String>,
}

const FILES: [(&str, &str); 1] = [("en", include_str!("languages/en.json"))];

static ALL: LazyLock<Vec<Words>> = LazyLock::new(|| {
    let words = |(language, json)| Words {
        language,
        json,
        // What is not JSON is found by the test, and would show its keys.
        by_key: serde_json::from_str(json).unwrap_or_default(),
    };
    FILES.map(words).into()
});

impl Words {
    /// Those of this language, else of the first one in a browser's `Accept-Language` that there is, else English.
    pub(in crate::observe) fn choose(named: Option<&str>, accepted: &str) -> &'static Words {
        let of = |wanted: &str| ALL.iter().find(|words| words.language.eq_ignore_ascii_case(wanted));
        named.and_then(of).or_else(|| preferred(accepted).into_iter().find_map(of)).unwrap_or(&ALL[0])
    }

    /// The word of this key.
    pub(super) fn get(&self, key: &'static str) -> &str {
        self.by_key.get(key).map_or(key, String::as_str)
    }
}

/// `de-CH,de;q=0.9,en;q=0.8`: the languages without their countries, the most wanted first.
fn preferred(accepted: &str) -> Vec<&str> {
    let mut wanted: Vec<(f64, &str)> = accepted
        .split(',')
        .map(|one| {
            let (range, quality) = one.split_once(";q=").unwrap_or((one, "1"));
            let language = range.trim().split('-').next().unwrap_or_default();
            (quality.trim().parse().unwrap_or(0.0), language)
        })
        .filter(|(quality, _)| *quality > 0.0)
        .collect();
    wanted.sort_by(|one, other| other.0.total_cmp(&one.0));
    wanted.into_iter().map(|(_, language)| language).collect()
}
