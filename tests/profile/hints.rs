//! Hints that must be correct: ports that are too large, IPv6 addresses without brackets, unsupported units.

use super::*;

/// Returns the hint of the only error, which is at this key.
#[track_caller]
fn help(text: &str, key: &str) -> String {
    let found = errors(parse(text));
    let [error] = found.as_slice() else { panic!("{}", Errors(found.clone())) };
    assert_eq!(error.key, key, "{error}");
    error.help.clone().unwrap()
}

fn bus(address: &str) -> String {
    GRINDER.replacen("127.0.0.1:1502", address, 1)
}

#[test]
fn a_port_above_65535_is_named_as_that_wherever_an_address_stands() {
    let page = |listen: &str| GRINDER.replacen("127.0.0.1:0", listen, 1);
    let broker = |url: &str| format!("{GRINDER}\n[mqtt]\nbroker = \"{url}\"\n");
    let server = |url: &str| format!("{GRINDER}\n[[notify]]\nurl = \"{url}\"\non = [\"alarm\"]\n");
    let opcua = |url: &str| {
        format!("{GRINDER}\n[bus.server]\ntype = \"opcua\"\nsecurity = \"none\"\naddress = \"{url}\"\n")
    };
    for (text, key, meant) in [
        (bus("127.0.0.1:99999"), "bus.cell.address", "127.0.0.1:502"),
        (bus("[::1]:65536"), "bus.cell.address", "[::1]:502"),
        (bus("::1:99999"), "bus.cell.address", "[::1]:502"),
        (page("127.0.0.1:99999"), "web.listen", "127.0.0.1:8080"),
        (broker("mqtts://broker.example:88830"), "mqtt.broker", "\"mqtts://broker.example:8883\""),
        (opcua("opc.tcp://10.0.0.7:99999/plc"), "bus.server.address", "\"opc.tcp://10.0.0.7:4840\""),
        (server("https://alarms.example:99999/x"), "notify[0].url", "1 to 65535"),
    ] {
        let help = help(&text, key);
        assert!(help.starts_with("the port is above 65535") && help.contains(meant), "{key}: {help}");
    }
    let help = help(&bus("tcp://10.0.0.7:99999/"), "bus.cell.address");
    assert!(help.contains("\"10.0.0.7:502\""), "{help}");
}

#[test]
fn an_ipv6_address_without_brackets_is_refused_and_shown_with_them() {
    for (address, meant) in [
        ("::1:15921", "write [::1]:15921"),
        ("::1:502", "write [::1]:502"),
        ("fe80::1", "write [fe80::1]:502"),
        ("2001:db8::7:1502", "write [2001:db8::7]:1502"),
    ] {
        let help = help(&bus(address), "bus.cell.address");
        assert!(help.ends_with(meant), "{address}: {help}");
    }
    let listen = help(&GRINDER.replacen("127.0.0.1:0", "::1:8080", 1), "web.listen");
    assert!(listen.ends_with("write [::1]:8080"), "{listen}");
    let broker = help(&format!("{GRINDER}\n[mqtt]\nbroker = \"mqtt://::1:1884\"\n"), "mqtt.broker");
    assert!(broker.ends_with("write \"mqtt://[::1]:1884\""), "{broker}");
    let url = "[[notify]]\nurl = \"https://::1:8443/x\"\non = [\"alarm\"]\n";
    let url = help(&format!("{GRINDER}\n{url}"), "notify[0].url");
    assert!(url.contains("brackets") && url.contains("https://[::1]:8443"), "{url}");
    for address in ["[::1]:15921", "[fe80::1%2]:502", "plc.cell:502", "10.0.0.7:1502"] {
        assert!(parse(&bus(address)).is_ok(), "{address}");
    }
    // Any other text gets a hint with a valid example.
    for address in ["10.0.0.7:", "10.0.0.7:http", ":502", "a:b:c"] {
        let help = help(&bus(address), "bus.cell.address");
        assert!(help.contains("as \"192.168.0.10:502\""), "{address}: {help}");
    }
    let help = help(&bus("10.0.0.7"), "bus.cell.address");
    assert!(help.contains("as \"10.0.0.7:502\""), "{help}");
}

#[test]
fn a_unit_that_a_profile_does_not_know_is_converted_at_the_scale_that_stands_there() {
    // The wheelhead is read in tenths.
    let wheelhead = |unit: &str| GRINDER.replacen("unit = \"degC\"", &format!("unit = \"{unit}\""), 1);
    for unit in ["degF", "F", "°F", "fahrenheit", "Fahrenheit"] {
        let help = help(&wheelhead(unit), "signal.wheelhead.unit");
        let words = "there is no Fahrenheit: write \"degC\" with scale = 0.05556 and offset = -17.78";
        assert!(help.contains(words), "{unit}: {help}");
    }
    let whole = wheelhead("degF").replacen("scale = 0.1\nbad", "bad", 1);
    let whole = help(&whole, "signal.wheelhead.unit");
    assert!(whole.contains("scale = 0.5556 and offset = -17.78"), "{whole}");
    for (unit, meant) in
        [("celsius", "degC"), ("C", "degC"), ("°C", "degC"), ("Kelvin", "K"), ("degK", "K"), ("k", "K")]
    {
        let help = help(&wheelhead(unit), "signal.wheelhead.unit");
        assert!(help.starts_with(&format!("did you mean `{meant}`?")), "{unit}: {help}");
    }
    // For a variable, the scale of the profile applies.
    let variable = [("ISOTHERM__SIGNAL__BED__UNIT".to_owned(), "degF".to_owned())];
    let found = errors(isotherm_profile::parse(Path::new("machine.toml"), GRINDER, &[], &variable));
    assert!(found[0].help.as_ref().unwrap().contains("scale = 0.05556 and offset = -17.78"), "{}", found[0]);
}
