//! What is not built yet is read, checked, and refused with these very words.

use super::*;

#[test]
fn what_is_not_built_yet_says_so_where_it_stands() {
    let cases =
        [("[history]", "[mqtt]\nbroker = \"mqtt://127.0.0.1:1883\"\nformat = \"json\"\n\n[history]", "mqtt")];
    for (from, to, key) in cases {
        let found = errors(with(from, to));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, key);
        assert!(found[0].message.starts_with("not built yet: "), "{}", found[0]);
    }
}

#[test]
fn what_is_not_built_yet_is_still_checked() {
    let found = errors(with("[history]", "[mqtt]\nbrokr = \"x\"\n\n[history]"));
    let reported: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert!(reported.contains(&"mqtt") && reported.contains(&"mqtt.brokr"), "{reported:?}");
}
