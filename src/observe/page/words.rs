//! Texts of the web page in each language. Each language has one file, and all files have the same keys.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use isotherm_profile::Language;

/// Texts of the web page in one language.
pub(in crate::observe) struct Words {
    /// Code of the language, as in the attribute `lang` and the header `Accept-Language`.
    pub(super) language: &'static str,
    /// Content of the file, which the scripts of the web page read.
    pub(super) json: &'static str,
    by_key: BTreeMap<String, String>,
}

const FILES: [(&str, &str); 4] = [
    ("en", include_str!("languages/en.json")),
    ("de", include_str!("languages/de.json")),
    ("ja", include_str!("languages/ja.json")),
    ("zh", include_str!("languages/zh.json")),
];

static ALL: LazyLock<Vec<Words>> = LazyLock::new(|| {
    let words = |(language, json)| Words {
        language,
        json,
        // A test finds a file that is not valid JSON. The page would show its keys.
        by_key: serde_json::from_str(json).unwrap_or_default(),
    };
    FILES.map(words).into()
});

impl Words {
    /// Returns the texts in the language `named`. If it is `None`, the first available language of the header
    /// `Accept-Language` is used, or English.
    pub(in crate::observe) fn choose(named: Option<Language>, accepted: &str) -> &'static Words {
        let of = |wanted: &str| ALL.iter().find(|words| words.language.eq_ignore_ascii_case(wanted));
        named
            .and_then(|named| of(named.code()))
            .or_else(|| preferred(accepted).into_iter().find_map(of))
            .unwrap_or(&ALL[0])
    }

    /// Returns the text with this key; the key itself if the language has no such text.
    pub(super) fn get(&self, key: &'static str) -> &str {
        self.by_key.get(key).map_or(key, String::as_str)
    }
}

/// Returns the languages in a header such as `de-CH,de;q=0.9,en;q=0.8`, without countries, the preferred language
/// first.
fn preferred(accepted: &str) -> Vec<&str> {
    let mut wanted: Vec<(f64, &str)> = accepted
        .split(',')
        .map(|one| {
            let (range, weight) = one.split_once(';').unwrap_or((one, "q=1"));
            let quality = weight.trim().strip_prefix("q=").and_then(|quality| quality.parse().ok());
            let language = range.trim().split('-').next().unwrap_or_default();
            (quality.unwrap_or(0.0), language)
        })
        .filter(|(quality, _)| *quality > 0.0)
        .collect();
    wanted.sort_by(|one, other| other.0.total_cmp(&one.0));
    wanted.into_iter().map(|(_, language)| language).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::page::FILES as FILES_OF_THE_PAGE;

    /// Returns the content of all files that use the texts of the page: its scripts, and the Rust files that
    /// make HTML.
    fn uses() -> String {
        let scripts =
            FILES_OF_THE_PAGE.iter().filter(|(name, ..)| name.ends_with(".js")).map(|(.., text)| *text);
        let shells = [include_str!("../page.rs"), include_str!("login.rs"), include_str!("../http/login.rs")];
        scripts.chain(shells).collect()
    }

    fn named(text: &str) -> Vec<&str> {
        text.split('{').skip(1).filter_map(|rest| Some(rest.split_once('}')?.0)).collect()
    }

    #[test]
    fn every_language_has_the_same_keys_each_once_with_the_same_values_in_them() {
        let english = &ALL[0];
        assert!(english.by_key.len() > 100, "{}", english.by_key.len());
        for words in ALL.iter() {
            let keys = words.by_key.keys().collect::<Vec<_>>();
            assert_eq!(keys, english.by_key.keys().collect::<Vec<_>>(), "{}", words.language);
            assert_eq!(words.json.matches("\": \"").count(), keys.len(), "{}: a key twice", words.language);
            assert!(!words.json.contains('<'), "{}: it stands inside a page", words.language);
            for (key, word) in &words.by_key {
                assert!(!word.trim().is_empty(), "{}: {key} is empty", words.language);
                let sorted = |text| {
                    let mut values = named(text);
                    values.sort_unstable();
                    values
                };
                assert_eq!(sorted(word), sorted(&english.by_key[key]), "{}: {key}", words.language);
            }
        }
    }

    #[test]
    fn every_word_is_used_and_every_word_that_is_used_is_there() {
        let all = uses();
        for key in ALL[0].by_key.keys() {
            // The gateway's value selects one word of such a group.
            let used = match key.split_once('.') {
                Some((kind, _)) => format!("known(\"{kind}\""),
                None if key.starts_with("past_") && key.ends_with(['h', 'd']) => "`past_${name}`".to_owned(),
                None if key.starts_with("ask_") => "`ask_${command}".to_owned(),
                None => format!("\"{key}\""),
            };
            assert!(all.contains(&used), "nobody says {key}");
        }
        for use_of in ["t(\"", "words.get(\""] {
            let mut before = "";
            for part in all.split(use_of) {
                // A longer name may end in the same way.
                let whole = !before.ends_with(|last: char| last.is_alphanumeric() || last == '_');
                if let Some(key) = part.split('"').next().filter(|_| whole && !before.is_empty()) {
                    assert!(ALL[0].by_key.contains_key(key), "there is no {key}");
                }
                before = part;
            }
        }
    }

    #[test]
    fn every_state_and_every_reason_has_its_word() {
        for (_, name, words, _) in isotherm_core::display::Display::ALL {
            let key = format!("state.{name}");
            assert_eq!(ALL[0].by_key[&key], words, "the same words as in the terminal");
            assert!(ALL[0].by_key.contains_key(&format!("does.{name}")), "{name}");
        }
    }

    #[test]
    fn the_profiles_language_is_spoken_else_the_first_that_the_browser_wants_else_english() {
        let of = |named, accepted| Words::choose(named, accepted).language;
        assert_eq!(of(Some(Language::Ja), "de"), "ja");
        for (accepted, language) in [
            ("", "en"),
            ("fr", "en"),
            ("de-CH,de;q=0.9,en;q=0.8", "de"),
            ("fr;q=0.9, zh-Hans-CN ; q=0.5, en;q=0.4", "zh"),
            ("en;q=0.2,ja;q=0.7", "ja"),
            ("ja;q=0,DE", "de"),
            ("*;q=x,;;", "en"),
        ] {
            assert_eq!(of(None, accepted), language, "{accepted}");
        }
    }
}
