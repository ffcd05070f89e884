//! Temperatures and controls over OPC UA.

use super::*;

/// Input for the questions: Enter up to the destination of Cz; then a node with type and scale, the address of the
/// server, and the node of the machine.
#[cfg(feature = "opcua")]
const NODES: &str =
    "\n\n\n\n\n\n\n\n\n\nns=2;s=Offset.Z\nf64\n1000\nopc.tcp://192.168.0.20:4840/nc\nns=2;s=On\n";

/// Temperatures from the nodes of a server: two elements of arrays. The control is the same server.
#[cfg(feature = "opcua")]
const ONE_SERVER: &str = "\nOPC.TCP://192.168.0.10\n\nns=2;s=Temps\n2\nnsu=urn:plc;i=7\nx\n1, 2\n\n\n\nns=2;s=Offset.Z\ni32\n\
                          0.1\nsame\n\n";

#[cfg(feature = "opcua")]
#[track_caller]
fn of_nodes(lines: &str) -> (Answers, String) {
    let (answers, shown) = answered(lines);
    (answers.unwrap_or_else(|error| panic!("{error}\n{shown}")), shown)
}

#[cfg(feature = "opcua")]
#[test]
fn the_node_of_the_offset_gives_a_profile_that_check_takes() {
    let answers = of_nodes(NODES).0;
    let profile = taken(&answers);
    let [module, control] = profile.buses.as_slice() else { panic!("two lines: {profile:?}") };
    assert_eq!(module.transport, isotherm_profile::Transport::Tcp);
    assert_eq!(
        (control.transport, control.address.as_str()),
        (isotherm_profile::Transport::OpcUa, "opc.tcp://192.168.0.20:4840/nc")
    );
    let security = control.opcua.as_ref().map(|settings| settings.security);
    assert_eq!(security, Some(isotherm_profile::Security::None));
    let output = &profile.outputs[0];
    let node = output.address.node().unwrap();
    assert_eq!(node.to_string(), "ns=2;s=Offset.Z");
    assert_eq!((node.taken_as().name(), output.writes), ("f64", Writes::Offset));
    assert!((output.encoding.scale.get() - 1000.0).abs() < 1e-9);
    let on = profile.machine.on.map(|id| profile.signal(id)).unwrap();
    assert_eq!(on.address.node().map(ToString::to_string).as_deref(), Some("ns=2;s=On"));
    let warnings: Vec<String> = preview::warnings(&profile).iter().map(ToString::to_string).collect();
    assert!(warnings.iter().all(|warning| warning.contains("model")), "{warnings:?}");
}

/// The lines that the profile shows as comments replace `security = "none"`.
#[cfg(feature = "opcua")]
#[test]
fn the_comments_of_the_profile_show_the_keys_of_a_secured_line() {
    let text = text::profile(&of_nodes(NODES).0);
    let secured = text
        .replace("security = \"none\" ", "# none")
        .replace("# security = ", "security = ")
        .replace("# cert ", "cert ")
        .replace("# key ", "key ")
        .replace("# trusted ", "trusted ")
        .replace("# user ", "user ");
    let refused = isotherm_profile::parse(Path::new("first.toml"), &secured, &[], &[]);
    let why = refused.err().map(|errors| errors.to_string()).unwrap_or_default();
    for file in ["own.der", "own.pem", "opcua.password"] {
        assert!(why.contains(file), "only the files are missing: {file}: {why}\n{secured}");
    }
    assert!(!why.contains("unknown"), "{why}");
}

#[cfg(feature = "opcua")]
#[test]
fn a_node_may_have_a_uri_and_quotes_in_its_name() {
    for node in ["nsu=http://plc.example/data;s=Offset.Z", "ns=3;s=\"Data\".\"Offset's\"[2]", "ns=3;i=1005"] {
        let answers = of_nodes(&NODES.replacen("ns=2;s=Offset.Z", node, 1)).0;
        let profile = taken(&answers);
        assert_eq!(profile.outputs[0].address.node().map(ToString::to_string).as_deref(), Some(node));
    }
}

#[cfg(feature = "opcua")]
#[test]
fn nothing_of_a_node_has_a_default_except_the_machine_start() {
    let given = [
        ("--output", "ns=2;s=Offset.Z"),
        ("--output-type", "i32"),
        ("--output-scale", "0.1"),
        ("--control", "192.168.0.20:4840"),
    ];
    for (count, (missing, _)) in given.iter().enumerate() {
        let options = given[..count].iter().flat_map(|(option, value)| [*option, *value]);
        let options: Vec<&str> = ["--yes"].into_iter().chain(options).collect();
        let why = answered_with(&options, "").0.unwrap_err().to_string();
        assert!(why.contains(&format!("{missing} is needed")), "{options:?}: {why}");
    }
    let options = given.iter().flat_map(|(option, value)| [*option, *value]);
    let options: Vec<&str> = ["--yes"].into_iter().chain(options).collect();
    let answers = answered_with(&options, "").0.unwrap();
    assert_eq!(answers.control, Some(Line::OpcUa("opc.tcp://192.168.0.20:4840".to_owned())));
    assert_eq!(answers.machine_on, MachineOn::Unknown);
    assert_eq!(taken(&answers).outputs.len(), 1);
}

#[cfg(feature = "opcua")]
#[test]
fn a_wrong_answer_about_a_server_is_asked_for_again_with_the_reason() {
    let lines = NODES
        .replacen("ns=2;s=Offset.Z\nf64", "opc.tcp://cnc\nns=2\nns=2;s=Offset.Z\n?\ndecimal24\nbool\nf64", 1)
        .replacen("opc.tcp://192", "same\n192.168.0.20:502\nopc.https://cnc:4843\nOPC.TCP://192", 1)
        .replacen("ns=2;s=On", "discrete:0\nns=2;s=On", 1);
    let (answers, shown) = of_nodes(&lines);
    assert_eq!(answers, of_nodes(NODES).0);
    for why in [
        "opc.tcp://cnc is the address of an OPC UA server, which a later question asks for",
        "`ns=2` has no `;`",
        "f64 a Double",
        "allowed: i8, u8",
        "the destination of Cz is a node of an OPC UA server",
        "write \"opc.tcp://cnc:4843\"",
        "`discrete:0` is not a node",
    ] {
        assert!(shown.contains(why), "{why}: {shown}");
    }
    let options = ["--yes", "--output", "linuxcnc-eoffset", "--control", "opc.tcp://cnc"];
    let why = answered_with(&options, "").0.unwrap_err().to_string();
    assert!(why.contains("opc.tcp://cnc is an OPC UA server, which has no registers"), "{why}");
}

#[cfg(feature = "opcua")]
#[test]
fn temperatures_are_nodes_or_elements_of_arrays() {
    let (answers, shown) = of_nodes(ONE_SERVER);
    assert!(shown.contains("write an index from 0"), "{shown}");
    let profile = taken(&answers);
    assert_eq!(profile.buses.len(), 1, "{shown}");
    assert_eq!(profile.buses[0].address, "opc.tcp://192.168.0.10:4840");
    let place = |signal: &isotherm_profile::Signal| {
        let node = signal.address.node().unwrap();
        (node.to_string(), node.element.as_ref().unwrap().to_string())
    };
    let found: Vec<(String, String)> = profile.signals.iter().map(place).collect();
    let expected = [("ns=2;s=Temps", "element 2"), ("nsu=urn:plc;i=7", "element 1, 2")];
    assert_eq!(found, expected.map(|(node, element)| (node.to_owned(), element.to_owned())));
    let options = "--yes --bus opc.tcp://192.168.0.10:4840 --node ns=2;s=Temps --element 2 --node nsu=urn:plc;i=7 \
                   --element 1,2 --output ns=2;s=Offset.Z --output-type i32 --output-scale 0.1 --control";
    for control in ["same", "192.168.0.10:4840"] {
        let options: Vec<&str> = options.split(' ').chain([control]).collect();
        assert_eq!(answered_with(&options, "").0.unwrap(), answers, "{control}");
    }
}

#[cfg(feature = "opcua")]
#[test]
fn a_control_with_registers_is_not_on_the_line_of_a_server() {
    let options =
        "--yes --bus 192.168.0.10:4840 --signals bed --node ns=2;s=Bed --scale 0.1 --output linuxcnc-eoffset";
    let options: Vec<&str> = options.split(' ').collect();
    let answers = answered_with(&options, "").0.unwrap();
    assert_eq!(answers.control, Some(Line::Tcp("192.168.0.20:502".to_owned())));
    let profile = taken(&answers);
    let scale = profile.signals[0].encoding.scale.get();
    assert!(profile.buses.len() == 2 && (scale - 0.1).abs() < 1e-12, "{scale}");
    let why = answered_with(&[&options[..], &["--control", "same"]].concat(), "").0.unwrap_err().to_string();
    assert!(why.contains("the module has no registers, so the control needs another line"), "{why}");
    let options = ["--yes", "--bus", "opc.tcp://cnc", "--signals", "bed"];
    let why = answered_with(&options, "").0.unwrap_err().to_string();
    assert!(why.contains("--node is needed"), "{why}");
}

#[cfg(feature = "opcua")]
#[test]
fn the_address_of_a_server_may_have_another_scheme_or_none() {
    for (written, url) in [
        ("opc.tcp://192.168.0.10/nc", "opc.tcp://192.168.0.10:4840/nc"),
        ("OPC.TCP://cnc:4841", "opc.tcp://cnc:4841"),
        ("opcua://[::1]:4840", "opc.tcp://[::1]:4840"),
        ("cnc:4840", "opc.tcp://cnc:4840"),
    ] {
        assert_eq!(Line::parse(written), Ok(Line::OpcUa(url.to_owned())));
    }
    let why = Line::parse("opc.https://cnc:4843").unwrap_err();
    assert!(why.contains("write \"opc.tcp://cnc:4843\""), "{why}");
}

#[cfg(feature = "opcua")]
#[test]
fn the_first_reading_shows_the_value_of_the_node() {
    for lines in [NODES, ONE_SERVER] {
        shows_the_first_reading(taken(&of_nodes(lines).0));
    }
}

/// Reads the profile once from virtual devices.
#[cfg(feature = "opcua")]
#[track_caller]
fn shows_the_first_reading(profile: isotherm_profile::Profile) {
    let (tell, told) = std::sync::mpsc::channel();
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    let devices = std::thread::spawn(move || {
        crate::cli::runtime::start().unwrap().block_on(async {
            let setup = Setup { ports: Ports::Free, ..Setup::default() };
            let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
            tell.send(machine.serving(profile)).unwrap();
            ended.await.unwrap();
            machine.stop().await.unwrap();
        });
    });
    let home = tempfile::tempdir().unwrap();
    let status = read_once::once(told.recv().unwrap(), home.path().to_owned()).unwrap();
    let shown = read_once::fieldbus(&status, &mut Hints::default());
    assert!(shown.contains("ns=2;s=Offset.Z") && shown.contains("holds 0.0000 µm"), "{shown}");
    assert!(status.signals.iter().all(|signal| signal.value.is_some()), "{:?}", status.signals);
    end.send(()).unwrap();
    devices.join().unwrap();
}

#[cfg(not(feature = "opcua"))]
#[test]
fn a_program_without_opc_ua_names_the_build_that_has_it() {
    let usual = ["--yes", "--output", "linuxcnc-eoffset", "--control", "opc.tcp://192.168.0.20:4840"];
    let bus = ["--yes", "--bus", "192.168.0.10:4840"];
    for options in [&usual[..], &bus[..], &["--yes", "--output", "ns=2;s=Offset.Z"][..]] {
        let why = answered_with(options, "").0.unwrap_err().to_string();
        assert!(why.contains("cargo build --release --features opcua"), "{options:?}: {why}");
    }
}
