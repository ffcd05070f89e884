//! `[[notify]]`: servers, and the events that are posted to them.

use isotherm_profile::TRIGGERS;
use isotherm_profile::preview::Preview;

use super::*;

const TABLE: &str =
    "[[notify]]\nurl = \"https://hooks.example/in/hidden?key=hidden\"\non = [\"alarm\", \"device-lost\"]\n";

fn posts(table: &str) -> String {
    format!("{GRINDER}\n{table}")
}

#[track_caller]
fn is_refused(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(TABLE.contains(from), "{from}");
    let error = only_error(&posts(&TABLE.replacen(from, to, 1)), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn where_what_is_posted_is_shown_without_what_may_be_secret() {
    let more = "[[notify]]\nurl = \"http://127.0.0.1:8065/hooks/hidden\"\non = [\"axis-off\"]\ntoken_file = \"notify.token\"\n";
    let loaded = parse(&posts(&format!("{TABLE}{more}"))).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let profile = loaded.profile;
    assert_eq!(profile.notify[0].on, ["alarm", "device-lost"]);
    assert_eq!(profile.notify[0].url.target(None).as_deref(), Some("/in/hidden?key=hidden"));
    let said = Preview::of(&profile).to_string();
    for line in [
        "  notify[0] to https://hooks.example, trusting the certificate authorities of this computer: alarm, \
         device-lost\n",
        "  notify[1] to http://127.0.0.1:8065, with the token in notify.token, in plain text: axis-off\n",
    ] {
        assert!(said.contains(line), "{said}");
    }
    let json = serde_json::to_value(Preview::of(&profile)).unwrap();
    assert_eq!(json["notify"][1]["token_file"], "notify.token");
    assert_eq!(json["notify"][0]["on"][1], "device-lost");
    assert!(
        !said.contains("hidden")
            && !json.to_string().contains("hidden")
            && !format!("{profile:?}").contains("hidden")
    );
}

#[test]
fn a_token_in_the_address_has_a_file_and_the_address_is_shown_without_both() {
    let within = TABLE.replace("/in/hidden?key=hidden", "/in/{token}");
    let with_file = posts(&format!("{within}token_file = \"hook.token\"\n"));
    let profile = parse(&with_file).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let said = Preview::of(&profile).to_string();
    let line = "  notify[0] to https://hooks.example, with the token in hook.token as a part of the address, trusting";
    assert!(said.contains(line), "{said}");
    let error = only_error(&posts(&within), "notify[0].url", "\"https");
    assert!(error.to_string().contains("the address has a placeholder for a token"), "{error}");
    assert!(error.help.unwrap().contains("`token_file`"));
}

#[test]
fn how_long_a_stop_takes_is_said_with_whoever_is_told_of_it_and_without() {
    let stop = |text: &str| {
        let profile = parse(text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        let said = Preview::of(&profile).to_string();
        said.split_once("stop\n").unwrap().1.to_owned()
    };
    assert!(stop(&posts(TABLE)).trim_end().ends_with(", then at most 2s until the last messages are posted"));
    assert!(!stop(GRINDER).contains("messages"));
    let broker = "[mqtt]\nbroker = \"mqtt://127.0.0.1:1883\"\n\n";
    assert!(
        stop(&format!("{broker}{GRINDER}"))
            .trim_end()
            .ends_with(", then at most 4s until the broker has the last state")
    );
    // Both waits run at the same time.
    let both = ", then at most 4s until the broker has the last state and the last messages are posted";
    assert!(stop(&format!("{broker}{}", posts(TABLE))).trim_end().ends_with(both));
}

#[test]
fn a_word_that_is_no_event_is_refused_with_the_nearest_and_all_that_there_are() {
    let words = ["`device-lots` is not allowed here", "did you mean `device-lost`?", "command-dropped"];
    is_refused("device-lost", "device-lots", "notify[0].on[1]", "\"device-lots", &words);
    let error =
        only_error(&posts(&TABLE.replace("device-lost", "hydraulics")), "notify[0].on[1]", "\"hydraulics");
    let help = error.help.unwrap();
    assert!(TRIGGERS.iter().all(|word| help.contains(word)), "{help}");
}

#[test]
fn what_is_wrong_with_an_address_is_said_and_what_is_secret_of_it_is_not() {
    let url = "https://hooks.example/in/hidden?key=hidden";
    for (to, words) in [
        ("https://me:hidden@hooks.example/", "must not have a user or a password"),
        ("ftp://me:hidden@hooks.example/?hidden", "does not begin with https:// or http://"),
        ("https://hooks.example:0/?hidden", "an invalid port"),
        ("https://hooks.example/?hidden#x", "after `#`"),
    ] {
        is_refused(url, to, "notify[0].url", "\"", &[words]);
        let said = errors(parse(&posts(&TABLE.replace(url, to))))[0].to_string();
        assert!(!said.contains("hidden"), "{said}");
    }
    // The secret is not shown either if another key of the same line is wrong.
    let inline = format!("notify = [{{ url = \"{url}\", on = [\"alarm\"], tokn_file = \"x\" }}]\n{GRINDER}");
    let said = errors(parse(&inline))[0].to_string();
    assert!(said.contains("unknown key `tokn_file`") && !said.contains("hidden"), "{said}");
}

#[test]
fn what_makes_no_sense_together_is_refused_or_warned_of() {
    is_refused("[\"alarm\", \"device-lost\"]", "[]", "notify[0].on", "[]", &["nothing would be posted"]);
    let plain = TABLE.replace("https:", "http:");
    let with_ca = posts(&format!("{plain}ca = \"ca.pem\"\n"));
    let found = errors(isotherm_profile::parse_with(
        Path::new("machine.toml"),
        &with_ca,
        &[("ca.pem", b"x")],
        &[],
        &[],
    ));
    assert_eq!((found.len(), found[0].key.as_str()), (1, "notify[0].ca"), "{}", found[0]);
    let error = only_error(&posts(&format!("{TABLE}ca = \"none.pem\"\n")), "notify[0].ca", "\"none.pem");
    assert!(error.to_string().contains("none.pem"), "{error}");
    for (table, words) in [
        (format!("{plain}token_file = \"t\"\n"), "the token goes over the network in plain text"),
        (TABLE.replace("\"alarm\"", "\"alarm\", \"alarm\""), "`alarm` is listed twice"),
    ] {
        let warnings = parse(&posts(&table)).unwrap_or_else(|errors| panic!("{errors}")).warnings;
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].message.contains(words), "{}", warnings[0]);
    }
    let many = errors(parse(&posts(&TABLE.repeat(17))));
    assert!(many[0].message.contains("at most 16"), "{}", many[0]);
    let bare = errors(parse(&posts("[[notify]]\n")));
    let keys: Vec<&str> = bare.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(keys, ["notify[0].url", "notify[0].on"]);
}

#[test]
fn a_body_of_several_lines_is_accepted_and_shown() {
    let body = "body = '''\n{ \"text\": \"{machine}: {text}\",\n\t\"n\": 1 }'''\n";
    let loaded = parse(&posts(&format!("{TABLE}{body}"))).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let template = loaded.profile.notify[0].body.clone().unwrap();
    let filled = template.fill(|field| format!("<{field:?}>"));
    assert_eq!(filled, serde_json::json!({ "text": "<Machine>: <Text>", "n": 1 }));
    let preview = Preview::of(&loaded.profile);
    let line = "  notify[0] to https://hooks.example, trusting the certificate authorities of this computer, in the \
                form of `body`: alarm, device-lost\n";
    assert!(preview.to_string().contains(line), "{preview}");
    let json = serde_json::to_value(&preview).unwrap();
    assert_eq!(json["notify"][0]["body"]["text"], "{machine}: {text}");
    let whole = parse(&posts(TABLE)).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(
        serde_json::to_value(Preview::of(&whole)).unwrap()["notify"][0]["body"],
        serde_json::Value::Null
    );
}

#[test]
fn a_body_that_cannot_be_filled_is_rejected_with_a_hint() {
    for (body, words, help) in [
        ("'{machine}: {text}'", "this is not JSON", "inside quotation marks"),
        ("'{\"text\": \"{mashine}\"}'", "a message has no field `mashine`", "did you mean `machine`?"),
        ("'{\"{text}\": 1}'", "the key `{text}` contains the placeholder `{text}`", "only in values"),
    ] {
        let error = only_error(&posts(&format!("{TABLE}body = {body}\n")), "notify[0].body", body);
        assert!(error.message.contains(words), "{error}");
        assert!(error.help.unwrap().contains(help), "{body}");
    }
    let same = parse(&posts(&format!("{TABLE}body = '{{\"text\": \"an alarm\"}}'\n")));
    let warnings = same.unwrap_or_else(|errors| panic!("{errors}")).warnings;
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].message.contains("every message would have the same body"), "{}", warnings[0]);
    // Other texts of the table have one line.
    let error = only_error(
        &posts(
            &TABLE.replace("on = [\"alarm\", \"device-lost\"]", "on = [\"alarm\"]\ntoken_file = '''a\nb'''"),
        ),
        "notify[0].token_file",
        "'''a",
    );
    assert!(error.to_string().contains("a line break"), "{error}");
}
