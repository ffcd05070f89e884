//! `[mqtt]`: content and recipients of publications, with errors and warnings.

use super::*;
use std::time::Duration;

use isotherm_profile::MqttFormat;

fn published(lines: &str) -> Result<Loaded, Errors> {
    with("[history]", &format!("[mqtt]\n{lines}\n\n[history]"))
}

const HERE: &str = "broker = \"mqtt://127.0.0.1:1883\"";

#[test]
fn what_is_not_said_has_its_usual_value() {
    let loaded = published(HERE).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let mqtt = loaded.profile.mqtt.unwrap();
    assert_eq!((mqtt.format, mqtt.group.as_str()), (MqttFormat::Json, "isotherm"));
    assert_eq!((mqtt.every, mqtt.refresh), (Duration::from_secs(1), Duration::from_secs(60)));
    assert!(!mqtt.takes_measured && !mqtt.home_assistant && mqtt.user.is_none());
    assert_eq!(mqtt.primary_host, None);
    let all = "broker = \"mqtt://localhost\"\nformat = \"sparkplug-b\"\ngroup = \"plant 1\"\nevery = \"100ms\"\nrefresh = \"10s\"\n\
               buffer = \"10MB\"\ncommands = [\"measured\"]\nuser = { name = \"gw7\" }\nprimary_host = \"SCADA 1\"";
    let mqtt = published(all).unwrap().profile.mqtt.unwrap();
    assert_eq!((mqtt.format, mqtt.buffer, mqtt.takes_measured), (MqttFormat::SparkplugB, 10_000_000, true));
    assert_eq!(mqtt.broker.to_string(), "mqtt://localhost:1883");
    assert_eq!(mqtt.primary_host.as_deref(), Some("SCADA 1"));
}

#[test]
fn what_is_wrong_with_it_is_said_at_its_key() {
    for (lines, key, words) in [
        ("format = \"json\"", "mqtt", "`broker` is missing"),
        ("broker = \"127.0.0.1:1883\"", "mqtt.broker", "does not begin with mqtts:// or mqtt://"),
        ("broker = \"mqtt://gw7:secret@broker\"", "mqtt.broker", "must not have a user or a password"),
        ("format = \"sparkplug-b\"", "mqtt.group", "`group` is missing"),
        ("format = \"sparkplug-b\"\ngroup = \"a/b\"", "mqtt.group", "cannot begin a topic"),
        ("format = \"sparkplug-b\"\ngroup = \"STATE\"", "mqtt.group", "hosts publish their own state"),
        ("group = \"a/#\"", "mqtt.group", "cannot begin a topic"),
        ("group = \"$SYS\"", "mqtt.group", "cannot begin a topic"),
        ("group = \"a//b\"", "mqtt.group", "cannot begin a topic"),
        ("every = \"10ms\"", "mqtt.every", "does not publish a topic this often"),
        ("every = \"1min\"\nrefresh = \"30s\"", "mqtt.refresh", "shorter than `every`"),
        ("buffer = \"100MB\"", "mqtt.buffer", "only for format = \"sparkplug-b\""),
        (
            "format = \"sparkplug-b\"\ngroup = \"a\"\nbuffer = \"0MB\"",
            "mqtt.buffer",
            "too small for one minute",
        ),
        (
            "format = \"sparkplug-b\"\ngroup = \"a\"\nhome_assistant = true",
            "mqtt.home_assistant",
            "only for format = \"json\"",
        ),
        ("primary_host = \"scada\"", "mqtt.primary_host", "only for format = \"sparkplug-b\""),
        (
            "format = \"sparkplug-b\"\ngroup = \"a\"\nprimary_host = \"a/b\"",
            "mqtt.primary_host",
            "cannot be the name of a Sparkplug host",
        ),
        (
            "format = \"sparkplug-b\"\ngroup = \"a\"\nprimary_host = \"\"",
            "mqtt.primary_host",
            "cannot be the name of a Sparkplug host",
        ),
        ("tls = { ca = \"ca.pem\" }", "mqtt.tls", "only for mqtts://"),
        ("user = { name = \"gw7\", password_file = \"none\" }", "mqtt.user.password_file", ""),
    ] {
        let lines = if lines.contains("broker") || words.contains("`broker`") {
            lines.to_owned()
        } else {
            format!("{HERE}\n{lines}")
        };
        let found = errors(published(&lines));
        let one = found.iter().find(|error| error.key.starts_with(key));
        let one = one.unwrap_or_else(|| panic!("{lines}\n{}", Errors(found.clone())));
        assert!(one.message.contains(words) && one.help.is_some(), "{one}");
        assert!(!one.message.contains("secret"), "{one}");
    }
}

#[test]
fn no_word_arms_disarms_or_moves() {
    for word in ["arm", "disarm", "zero", "sign", "write"] {
        let found = errors(published(&format!("{HERE}\ncommands = [\"{word}\"]")));
        assert!(
            found.iter().any(|error| error.key.starts_with("mqtt.commands")),
            "{}",
            Errors(found.clone())
        );
        assert!(found[0].to_string().contains("measured"), "{}", found[0]);
    }
}

#[test]
fn what_others_may_read_or_forge_is_warned_of() {
    let plain = "broker = \"mqtt://broker.plant.example\"";
    for (lines, count) in [
        (plain.to_owned(), 1),
        (format!("{plain}\ncommands = [\"measured\"]"), 2),
        ("broker = \"mqtts://broker.plant.example\"\ncommands = [\"measured\"]".to_owned(), 0),
        (format!("{plain}\nformat = \"sparkplug-b\"\ngroup = \"a\"\nprimary_host = \"scada\""), 2),
        (format!("{HERE}\ncommands = [\"measured\"]"), 0),
    ] {
        let warnings = published(&lines).unwrap().warnings;
        let of_mqtt = warnings.iter().filter(|warning| warning.key.starts_with("mqtt"));
        assert_eq!(of_mqtt.count(), count, "{lines}: {warnings:?}");
    }
}
