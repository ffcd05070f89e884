//! Figures, registers and permissions that contradict each other.

use super::*;

#[test]
fn registers_that_collide_are_reported_with_both_places() {
    let line =
        |what: &str| format!("machine.toml:{}", GRINDER.lines().position(|line| line == what).unwrap() + 1);
    refused(
        "register = \"holding:100\"",
        "register = \"holding:105\"",
        "heartbeat.register",
        "\"holding:105\"",
        &["writes the same registers", &line("register = \"holding:104\"")],
    );
    refused(
        "register = \"holding:90\"",
        "register = \"holding:105\"",
        "output.cnc_z.register",
        "\"holding:104\"",
        &["overlaps", &line("register = \"holding:90\"")],
    );
    refused(
        "register = \"holding:104\"",
        "register = \"input:104\"",
        "output.cnc_z.register",
        "\"input:104\"",
        &["read-only"],
    );
    refused(
        "register = \"holding:104\"",
        "register = \"coil:4\"",
        "output.cnc_z.register",
        "\"coil:4\"",
        &["one bit"],
    );
    refused(
        "register = \"holding:84\"",
        "register = \"holding:65535\"",
        "signal.scale_z.register",
        "\"holding:65535\"",
        &["beyond the last register"],
    );
}

#[test]
fn the_same_value_may_have_two_names_and_be_read_back_as_a_signal() {
    let second = "[signal.bed_too]\ndevice = \"module\"\nregister = \"30001\"\ntype = \"i16\"\n\n[axis.z]";
    let echo = "[signal.offset]\ndevice = \"cnc\"\nregister = \"holding:104\"\ntype = \"i32\"\nword_order = \"msw-first\"\n\n[axis.z]";
    for more in [second, echo] {
        let loaded = with("[axis.z]", more).unwrap();
        assert_eq!((loaded.warnings.len(), loaded.profile.only_recorded.len()), (0, 1));
    }
}

#[test]
fn a_corrected_position_never_overwrites_its_own_scale() {
    let text = GRINDER.replacen("device = \"readout\"", "device = \"counter\"", 1).replacen(
        "register = \"holding:10\"",
        "register = \"holding:84\"",
        1,
    );
    let error = only_error(&text, "output.readout_z.register", "\"holding:84\"");
    assert!(error.message.contains("overwrite"), "{error}");
}

#[test]
fn figures_that_contradict_each_other_are_reported_with_both() {
    refused("step = 1.0", "step = 80.5", "axis.z.step", "80.5", &["80.5", "40"]);
    assert!(with("step = 1.0", "step = 80.0").is_ok(), "from −limit to +limit");
    refused("deadband = 0.1", "deadband = 40.0", "axis.z.deadband", "40.0", &["never change"]);
    refused("rate = 0.5", "rate = 0", "axis.z.rate", "0", &["above zero"]);
    refused(
        "scale = 0.1\nrefresh",
        "scale = 2.0\nrefresh",
        "output.cnc_z.scale",
        "2.0",
        &["one count is 2 µm", "1 µm"],
    );
    refused("range = [-10.0, 80.0]", "range = [80.0, -10.0]", "signal.wheelhead.range", "[80.0", &["empty"]);
    refused("scale = 0.0005", "scale = 0.0", "signal.scale_z.scale", "0.0", &["zero"]);
    refused(
        "bad = [-32768, 32767]",
        "bad = [32768]",
        "signal.wheelhead.bad",
        "[32768]",
        &["cannot contain 32768"],
    );
    refused(
        "max_age = \"5s\"",
        "max_age = \"1s\"",
        "signal.wheelhead.max_age",
        "\"1s\"",
        &["always become stale"],
    );
    refused("every = \"10s\"", "every = \"0s\"", "axis.z.every", "\"0s\"", &["zero"]);
    refused("unit = \"mm\"", "unit = \"um\"", "output.readout_z.position", "\"scale_z\"", &["in mm"]);
    refused(
        "address = \"127.0.0.1:1502\"",
        "address = \"127.0.0.1\"",
        "bus.cell.address",
        "\"127",
        &["127.0.0.1:502"],
    );
    for (written, says) in [
        ("http://10.0.0.7", &["is a URL", "\"10.0.0.7:502\""][..]),
        ("modbus://10.0.0.7:1502/", &["is a URL", "\"10.0.0.7:1502\""]),
        ("192.168.0.300:502", &["`192.168.0.300` is not an IP address", "0 to 255"]),
        ("192.168.10:502", &["is not an IP address"]),
    ] {
        let to = format!("address = \"{written}\"");
        refused("address = \"127.0.0.1:1502\"", &to, "bus.cell.address", &format!("\"{written}"), says);
    }
    refused(
        "name = \"grinder-1\"",
        "name = \"Grinder 1\"",
        "machine.name",
        "\"Grinder 1\"",
        &["small letters"],
    );
    refused(
        "action = \"ramp\"",
        "action = \"hold\"",
        "axis.z.on_fault.after",
        "\"60s\"",
        &["`after` is allowed only with action = \"ramp\""],
    );
}

#[test]
fn a_register_must_hold_the_limit() {
    let narrow = "type = \"i16\"\nscale = 0.001\nrefresh";
    let wide = "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1\nrefresh";
    refused(
        wide,
        narrow,
        "output.cnc_z.type",
        "\"i16\"",
        &["-40 to 40 µm exceed the range of i16", "-32768 to 32767"],
    );
    refused(wide, "type = \"u16\"\nscale = 0.1\nrefresh", "output.cnc_z.type", "\"u16\"", &["bias 0"]);
    assert!(with(wide, "type = \"u16\"\nscale = 0.1\nbias = 32768\nrefresh").is_ok());
    let corrected = "scale = 0.0001";
    refused(
        corrected,
        "scale = 1e-8",
        "output.readout_z.type",
        "\"i32\"",
        &["500.04 mm exceed the range of i32"],
    );
}

#[test]
fn a_diameter_is_counted_in_halves() {
    let loaded = with("deadband = 0.1", "deadband = 0.1\ndiameter = true").unwrap();
    let count = loaded.profile.axes[0].settings.guard.count.unwrap();
    assert!((count.get() - 0.05).abs() < 1e-12);
}

#[test]
fn a_function_that_the_device_may_not_be_sent_is_refused() {
    let functions = "functions = [\"read-holding\", \"write-multiple\"]";
    refused(
        functions,
        "functions = [\"read-holding\", \"write-single\"]",
        "output.readout_z.register",
        "\"holding:10\"",
        &["write-multiple", "`readout`"],
    );
    refused(
        functions,
        "functions = [\"write-multiple\"]",
        "output.readout_z.register",
        "\"holding:10\"",
        &["read-holding"],
    );
    refused(
        "unit = 2",
        "unit = 2\nfunctions = [\"read-input\"]",
        "signal.scale_z.register",
        "\"holding:84\"",
        &["read-holding"],
    );
}

#[test]
fn a_page_for_the_network_wants_a_token() {
    refused(
        "listen = \"127.0.0.1:0\"",
        "listen = \"0.0.0.0:8080\"",
        "web.listen",
        "\"0.0.0.0",
        &["token_file"],
    );
    refused(
        "listen = \"127.0.0.1:0\"",
        "listen = \"8080\"",
        "web.listen",
        "\"8080\"",
        &["not a host with a port"],
    );
    assert!(with("listen = \"127.0.0.1:0\"", "listen = \"[::1]:8080\"").is_ok());
    for key in ["token_file", "viewer_token_file", "scrape_token_file"] {
        let key = format!("listen = \"0.0.0.0:80\"\nplain = true\n{key} = \"/etc/token\"");
        assert!(with("listen = \"127.0.0.1:0\"", &key).is_ok());
    }
    refused(
        "listen = \"127.0.0.1:0\"",
        "token_file = \"/etc/token\"\nviewer_token_file = \"/etc/token\"",
        "web.viewer_token_file",
        "\"/etc/token\"",
        &["every viewer could give commands"],
    );
    for (other, whose) in [("token_file", "operator's"), ("viewer_token_file", "viewer's")] {
        refused(
            "listen = \"127.0.0.1:0\"",
            &format!("{other} = \"/etc/token\"\nscrape_token_file = \"/etc/token\""),
            "web.scrape_token_file",
            "\"/etc/token\"",
            &[whose, "only read /metrics"],
        );
    }
}

#[test]
fn a_page_for_the_network_wants_tls_or_that_somebody_says_it_may_be_plain() {
    let listen = "listen = \"127.0.0.1:0\"";
    let open = "listen = \"0.0.0.0:80\"\ntoken_file = \"/etc/token\"\n";
    let to = |more: &str| with(listen, &format!("{open}{more}"));
    for more in ["", "plain = false"] {
        let wrong = Errors(errors(to(more))).to_string();
        assert!(wrong.contains("web.listen: `0.0.0.0:80` is open to the network in plain text"), "{wrong}");
        assert!(wrong.contains("tls = {") && wrong.contains("plain = true"), "{wrong}");
    }
    let plain = to("plain = true").unwrap();
    let warned: Vec<String> = plain.warnings.iter().map(ToString::to_string).collect();
    assert!(plain.profile.web.unwrap().plain);
    assert!(
        warned.iter().any(|warning| warning.contains("web.plain") && warning.contains("can read the token")),
        "{warned:?}"
    );
    let secured = to("tls = { cert = \"page.pem\", key = \"/etc/page.key\" }").unwrap();
    assert!(secured.warnings.iter().all(|warning| !warning.to_string().contains("web.")));
    let tls = secured.profile.web.unwrap().tls.unwrap();
    assert!(tls.cert.ends_with("page.pem") && tls.key.is_absolute());
    let half = Errors(errors(to("tls = { cert = \"page.pem\" }"))).to_string();
    assert!(half.contains("web.tls.key") && half.contains("docs/page.md"), "{half}");
    // On this computer there is no other listener.
    assert!(
        with(listen, &format!("{listen}\nplain = true"))
            .unwrap()
            .warnings
            .iter()
            .all(|warning| !warning.to_string().contains("web."))
    );
}

#[test]
fn who_may_command_the_page_is_a_word_and_everybody_on_this_computer_is_warned_of() {
    let listen = "listen = \"127.0.0.1:0\"";
    let loaded = with(listen, "commands = \"local\"").unwrap();
    let warned = &loaded.warnings[0];
    assert!(warned.message.contains("every user of this computer can arm"), "{warned}");
    assert!(warned.help.as_deref().is_some_and(|help| help.contains("isotherm token --out")), "{warned}");
    assert_eq!(with(listen, "commands = \"token\"").unwrap().warnings, []);
    refused(listen, "commands = \"all\"", "web.commands", "\"all\"", &["token", "local"]);
    assert!(with(listen, "hosts = [\"gw7.plant.example\"]").is_ok());
    for host in ["http://gw7", "gw7:8080", "", "gw 7"] {
        let hosts = format!("hosts = [\"{host}\"]");
        refused(listen, &hosts, "web.hosts[0]", &format!("\"{host}\""), &["the name alone"]);
    }
}

#[test]
fn a_trusted_proxy_is_an_address_or_a_network_and_needs_a_token() {
    let listen = "listen = \"127.0.0.1:0\"";
    let token = "token_file = \"/etc/token\"\n";
    let proxies = |names: &str| format!("{token}trusted_proxies = [{names}]");
    let loaded = with(listen, &proxies("\"127.0.0.1\", \"10.0.0.0/24\", \"::1\"")).unwrap();
    let named = loaded.profile.web.unwrap().trusted_proxies;
    assert_eq!(named.len(), 3);
    assert!(
        named[1].contains("10.0.0.9".parse().unwrap()) && !named[1].contains("10.0.1.9".parse().unwrap())
    );
    for (name, hint) in [
        ("proxy.plant.example", "a host name is not allowed"),
        ("10.0.0.0/33", "at most 32"),
        ("::/0", "every address"),
    ] {
        let named = proxies(&format!("\"{name}\""));
        refused(listen, &named, "web.trusted_proxies[0]", &format!("\"{name}\""), &[hint]);
    }
    let bare = "trusted_proxies = [\"127.0.0.1\"]";
    refused(listen, bare, "web.trusted_proxies", "[\"127.0.0.1\"]", &["without a token", "token_file"]);
}

#[test]
fn what_is_odd_but_runs_is_a_warning() {
    let loaded = with("max_age = \"5s\"", "max_age = \"1500ms\"").unwrap();
    assert!(loaded.warnings[0].message.contains("one late answer"), "{}", loaded.warnings[0]);
    let unused = "[device.spare]\nbus = \"cell\"\nunit = 9\n\n[signal.wheelhead]";
    let loaded = with("[signal.wheelhead]", unused).unwrap();
    assert!(loaded.warnings[0].message.contains("nothing is read from `spare`"), "{}", loaded.warnings[0]);
}

#[test]
fn a_timeout_that_nobody_wrote_contradicts_nothing() {
    let loaded = with("timeout = \"300ms\"\n", "").unwrap();
    assert_eq!(loaded.profile.buses[0].timeout.as_millis(), 200);
}

#[test]
fn a_timeout_as_long_as_anything_is_due_on_its_line_is_one_warning_whatever_that_is() {
    let mut wrong = Vec::new();
    for (from, to, says) in [
        ("every = \"400ms\"", "every = \"300ms\"", "device `counter` is read every 300ms"),
        (
            "timeout = \"300ms\"",
            "timeout = \"2s\"",
            "device `counter` is read every 400ms, the heartbeat is written every 500ms",
        ),
        ("every = \"10s\"", "every = \"200ms\"", "axis `z` is written every 200ms"),
        ("refresh = \"2s\"", "refresh = \"100ms\"", "output `cnc_z` is refreshed every 100ms"),
        ("every = \"500ms\"", "every = \"250ms\"", "the heartbeat is written every 250ms"),
    ] {
        match with(from, to) {
            Ok(loaded) => {
                let doubts: Vec<String> = loaded.warnings.iter().map(ToString::to_string).collect();
                let is_right = |doubt: &String| {
                    doubt.contains(says)
                        && doubt.contains(".timeout")
                        && doubt.contains("write a `timeout` shorter than")
                };
                if !matches!(&doubts[..], [doubt] if is_right(doubt)) {
                    wrong.push(format!("{says}: {doubts:#?}"));
                }
            }
            Err(errors) => wrong.push(format!("{says}: {errors}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let unwritten =
        GRINDER.replace("timeout = \"300ms\"\n", "").replacen("every = \"10s\"", "every = \"200ms\"", 1);
    let loaded = parse(&unwritten).unwrap();
    assert_eq!(loaded.profile.buses[0].timeout.as_millis(), 100, "half the shortest of all");
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

/// Each mistake alone is reported, and so are both of any two.
#[test]
fn no_error_holds_another_back() {
    let faults = [
        ("name = \"grinder-1\"", "name = \"Grinder 1\"", "machine.name"),
        ("type = \"modbus-tcp\"", "type = \"modbus\"", "bus.cell.type"),
        ("address = \"127.0.0.1:1502\"", "address = \"127.0.0.1\"", "bus.cell.address"),
        ("unit = 3", "unit = 300", "device.readout.unit"),
        ("bus = \"cell\"\nunit = 2", "bus = \"cel\"\nunit = 2", "device.counter.bus"),
        ("functions = [\"read-holding\", ", "functions = [\"read\", ", "device.readout.functions"),
        ("register = \"30002\"", "register = \"input:70000\"", "signal.wheelhead.register"),
        ("max_age = \"5s\"", "max_age = \"1s\"", "signal.wheelhead.max_age"),
        ("range = [-10.0, 80.0]", "range = [80.0, -10.0]", "signal.wheelhead.range"),
        ("scale = 0.0005", "scale = 0.0", "signal.scale_z.scale"),
        ("limit = 40.0", "limit = -40.0", "axis.z.limit"),
        ("rate = 0.5", "rate = 0", "axis.z.rate"),
        (
            "on_fault = { action = \"ramp\", after = \"60s\" }",
            "on_fault = { action = \"stay\" }",
            "axis.z.on_fault.action",
        ),
        ("writes = \"offset\"", "writes = \"offsets\"", "output.cnc_z.writes"),
        ("refresh = \"2s\"", "refresh = \"2\"", "output.cnc_z.refresh"),
        ("every = \"500ms\"", "every = \"0s\"", "heartbeat.every"),
    ];
    let mut wrong = Vec::new();
    for (place, one) in faults.iter().enumerate() {
        assert!(GRINDER.contains(one.0), "{}", one.0);
        for other in &faults[place..] {
            let text = GRINDER.replacen(one.0, one.1, 1);
            let text = if one == other { text } else { text.replacen(other.0, other.1, 1) };
            let found = errors(parse(&text));
            for (_, _, key) in [one, other] {
                if !found.iter().any(|error| error.key.starts_with(key)) {
                    wrong.push(format!(
                        "{} and {}: not {key}, but {:?}",
                        one.2,
                        other.2,
                        found.iter().map(|error| &error.key).collect::<Vec<_>>()
                    ));
                }
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{}\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn a_share_of_an_operators_register_needs_whole_counts_that_can_be_read() {
    let ledger = "share = \"ledger\"";
    let shared = |from: &str, to: &str| GRINDER.replace("share = \"whole\"", ledger).replacen(from, to, 1);
    assert!(parse(&shared("", "")).is_ok());
    let coarse = "type = \"i32\"\nword_order = \"msw-first\"\nscale = 1.0";
    let fine = shared("type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1", coarse);
    let fine = only_error(&fine, "output.cnc_z.scale", "1.0");
    assert!(fine.to_string().contains("two counts"), "{fine}");
    let echo = shared(ledger, "share = \"ledger\"\nverify = \"echo\"");
    let echo = only_error(&echo, "output.cnc_z.verify", "\"echo\"");
    assert!(echo.to_string().contains("known only if the register is read"), "{echo}");
    let float = shared(
        "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1",
        "type = \"f32\"\nword_order = \"msw-first\"",
    );
    let float = only_error(&float, "output.cnc_z.share", "\"ledger\"");
    assert!(float.to_string().contains("an integer type"), "{float}");
    let corrected =
        GRINDER.replacen("writes = \"corrected\"", "writes = \"corrected\"\nshare = \"ledger\"", 1);
    let corrected = only_error(&corrected, "output.readout_z.share", "\"ledger\"");
    assert!(corrected.to_string().contains("only an offset"), "{corrected}");
}

#[test]
fn what_a_control_applies_is_read_elsewhere_and_of_a_whole_offset_alone() {
    let with = |read_back: &str| {
        GRINDER.replacen("share = \"whole\"", &format!("share = \"whole\"\nread_back = {read_back}"), 1)
    };
    let table = "{ register = \"input:112\", tolerance = 0.2, settle = \"500ms\" }";
    let loaded = parse(&with(table)).unwrap();
    let output = loaded.profile.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let applied = output.applied.as_ref().unwrap();
    assert_eq!((applied.address.to_string(), applied.settle.as_millis()), ("input:112".to_owned(), 500));
    assert_eq!(applied.encoding.scale, output.encoding.scale, "as the output's, where nothing else is said");
    let reported = |text: &str| parse(text).unwrap_err().to_string();
    assert!(reported(&with("\"6004:00\"")).contains("only on CAN"));
    assert!(reported(&with("{ register = \"coil:3\" }")).contains("cannot hold an offset"));
    assert!(reported(&with("{ tolerance = 0.2 }")).contains("`register` is missing"));
    assert!(
        reported(&with(table).replacen("share = \"whole\"", "share = \"ledger\"", 1))
            .contains("the gateway share cannot be read from it")
    );
    assert!(reported(&with("{ register = \"input:112\", tolerance = -1.0 }")).contains("more than zero"));
}

#[test]
fn two_questions_in_one_go_have_no_pause_between_them() {
    let bus = "quirks = { pause_between_requests = \"5ms\", max_gap = 4 }";
    let device = "quirks = { max_gap = 0 }";
    assert!(GRINDER.contains(bus) && GRINDER.contains(device));
    let plain = GRINDER.replacen(bus, "pipeline = 2", 1);
    assert_eq!(parse(&plain).unwrap().profile.buses[0].pipeline, 2);
    assert_eq!(parse(GRINDER).unwrap().profile.buses[0].pipeline, 1);
    assert_eq!(parse(&plain).unwrap().warnings, []);
    let offset = plain.replacen("writes = \"corrected\"\nposition = \"scale_z\"", "writes = \"offset\"", 1);
    let warned = parse(&offset).unwrap().warnings;
    let of_no_use = |warning: &ProfileError| {
        warning.key == "bus.cell.pipeline" && warning.message.contains("has no effect here")
    };
    assert_eq!(warned.iter().filter(|warning| of_no_use(warning)).count(), 1, "{warned:?}");
    only_error(&plain.replacen("pipeline = 2", "pipeline = 3", 1), "bus.cell.pipeline", "3");
    for quirk in ["close_after_each = true", "pause_between_requests = \"20ms\""] {
        let quirks = format!("pipeline = 2\nquirks = {{ {quirk} }}");
        let of_bus = only_error(&GRINDER.replacen(bus, &quirks, 1), "bus.cell.pipeline", "2");
        let quirks = format!("quirks = {{ {quirk} }}");
        let name = plain.split(device).next().unwrap().rsplit("[device.").next().unwrap();
        let key = format!("device.{}.quirks", name.split(']').next().unwrap());
        let of_device = only_error(&plain.replacen(device, &quirks, 1), &key, "{");
        for error in [of_bus, of_device] {
            assert!(error.to_string().contains("two requests at a time are not possible"), "{error}");
        }
    }
}
