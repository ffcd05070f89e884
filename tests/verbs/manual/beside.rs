//! Environment of a block, selected by the word after `with=`: a gateway with a page, a control, a line, sensors or a
//! mesh. It exists until the chapter ends.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::book::{Chapter, root};
use super::process::{Running, file};
use super::server;
use super::shop::Shop;
use super::tree::{PROBE, Tree};

/// Environment of a block.
#[derive(Default)]
pub(crate) struct Beside {
    /// Texts of the manual, and their replacements here.
    here: Vec<(&'static str, String)>,
    /// Input for a command of the block.
    pub(crate) typed: &'static str,
    _goes_on: Option<Running>,
    _tree: Option<Tree>,
}

impl Beside {
    /// Makes the environment for this word. `None` if the program lacks the feature for it.
    pub(crate) fn of(word: &str, chapter: &Chapter, shop: &mut Shop) -> Option<Beside> {
        match word {
            "page" => Some(page(shop)),
            "gauge" => Some(gauge(shop)),
            "line" => Some(line()),
            "opcua" => cfg!(feature = "opcua").then(|| control(chapter, shop)),
            "sensors" => Some(sensors(chapter, shop)),
            "mesh" => Some(mesh(chapter, shop)),
            "source" => Some(source(shop)),
            other => panic!("{}: nothing is called `{other}`", chapter.path.display()),
        }
    }

    /// Replaces the addresses of the manual in a command.
    pub(crate) fn here(&self, command: &str) -> String {
        self.here.iter().fold(command.to_owned(), |command, (theirs, ours)| command.replace(theirs, ours))
    }

    /// Replaces the actual addresses in the output by those of the manual.
    pub(crate) fn there(&self, said: &str) -> String {
        self.here.iter().fold(said.to_owned(), |said, (theirs, ours)| said.replace(ours, theirs))
    }
}

/// A gateway with a page that requires one of two tokens.
fn page(shop: &mut Shop) -> Beside {
    for token in ["operator.token", "viewer.token"] {
        let (said, code) = shop.run(&format!("isotherm token --out {token}"));
        assert_eq!(code, 0, "{said}");
    }
    let web = "[web]\nlisten = \"127.0.0.1:8080\"\ntoken_file = \"operator.token\"\nviewer_token_file = \"viewer.token\"\n";
    shop.write_profile(&(shop.profile.clone() + web));
    // The port is free; another program may have the port of the manual.
    let gateway = shop.begun("isotherm run my-machine.toml --listen 127.0.0.1:0", "page http://");
    Beside { _goes_on: Some(gateway), ..Beside::default() }
}

/// A gateway that waits to be armed, and the input of an operator at the dial gauge.
fn gauge(shop: &mut Shop) -> Beside {
    let by_hand = shop.profile.replacen("[machine]\n", "[machine]\narm = \"manual\"\n", 1);
    // During a check of the sign, the axis must not move.
    let still = by_hand.replacen("gain = -4.0", "gain = -0.001", 1);
    assert!(by_hand != shop.profile && still != by_hand);
    shop.write_profile(&still);
    let gateway = shop.begun("isotherm run my-machine.toml", "the gateway runs");
    Beside { typed: "\nplus\n", _goes_on: Some(gateway), ..Beside::default() }
}

/// Two units on a line. One lacks the requested register. For other units, a gateway reports that they do not exist.
fn line() -> Beside {
    let mut bank = vec![0; 102];
    (bank[0], bank[101], bank[100]) = (251, 0x86a0, 1);
    let address = server::serve(move |question, stream| {
        let pdu = match question.unit {
            2 if question.is_read() => question.read(&bank),
            1 | 2 => question.denied(2),
            _ => question.denied(11),
        };
        stream.write_all(&question.answer(&pdu))
    });
    Beside { here: vec![("192.168.0.10:502", address.to_string())], ..Beside::default() }
}

/// Python from the environment of `tests/run tools`.
fn python(script: &str) -> Command {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    assert!(python.exists(), "{}: it is not there: `tests/run tools` installs it", python.display());
    let mut command = Command::new(python);
    command.arg("-u").arg(root().join(script));
    command
}

/// A control with an OPC UA server and a certificate, and the chapter's profile with security.
fn control(chapter: &Chapter, shop: &mut Shop) -> Beside {
    let made = shop.home().join("of-the-control");
    std::fs::create_dir(&made).unwrap();
    let status = python("tests/interop/opcua_certificates.py").arg(&made).status().unwrap();
    assert!(status.success(), "certificates.py: {status}");
    let mut command = python("tests/verbs/manual/control.py");
    let mut server = Running::start(command.arg(made.join("server.der")).arg(made.join("server.pem")));
    let port = server.receives("listens on ").trim_start_matches("listens on ").to_owned();
    let address = format!("opc.tcp://127.0.0.1:{port}");
    let blocks = chapter.blocks();
    let whole = blocks.iter().find(|block| block.language == "toml" && block.is("whole")).unwrap();
    let secured = "\"sign-and-encrypt\"\ncert = \"own.der\"\nkey = \"own.pem\"\ntrusted = \"trusted\"";
    let profile = whole.text.replace("opc.tcp://192.168.214.241:4840", &address).replace("\"none\"", secured);
    // A handshake takes longer on a busy computer than with a real control.
    let patient = "[bus.nck]\ntimeout = \"5s\"\n";
    let profile = profile.replacen("[bus.nck]\n", patient, 1).replace("every = \"1s\"", "every = \"10s\"");
    shop.write_profile(&profile);
    std::fs::create_dir(shop.home().join("trusted")).unwrap();
    let here =
        vec![("opc.tcp://192.168.214.241:4840", address.clone()), ("opc.tcp://192.168.214.241", address)];
    Beside { here, typed: "yes\n", _goes_on: Some(server), _tree: None }
}

/// Sensors that the chapter's part of a profile names.
fn sensors(chapter: &Chapter, shop: &mut Shop) -> Beside {
    let tree = Tree::new();
    tree.measures(PROBE, 20_750);
    tree.hwmon(3, "lm75", "i2c-1/1-0048", &[("temp1_input", "31250")]);
    tree.iio(0, "mcp9808", "i2c-1/1-0018", &[("in_temp_raw", "344"), ("in_temp_scale", "62.5")]);
    let blocks = chapter.blocks();
    let part = &blocks.iter().find(|block| block.language == "toml").unwrap().text;
    let root = tree.root().display().to_string();
    let at = format!("[bus.pc]\naddress = \"{root}\"\n");
    let (profile, part) = (shop.profile.clone(), part.replacen("[bus.pc]\n", &at, 1));
    shop.write_profile(&(profile + &part));
    Beside { here: vec![("--bus /sys", format!("--bus {root}"))], _tree: Some(tree), ..Beside::default() }
}

/// Files of the chapter for Gmsh and for `place`. The text of the chapter names them in this order. The mesh is coarser
/// than in the chapter, so that it is solved faster.
fn mesh(chapter: &Chapter, shop: &Shop) -> Beside {
    let blocks = chapter.blocks();
    let all = |language: &'static str| blocks.iter().filter(move |block| block.language == language);
    let shape = &all("c").next().unwrap().text;
    let coarse = shape.replace("MeshSizeMax = 60;", "MeshSizeMax = 150;");
    assert_ne!(&coarse, shape);
    file(shop.home(), "column.geo", &coarse);
    let cards = all("text").filter(|block| block.text.starts_with('*'));
    let names = ["column.inp", "spindle.inp", "room.inp"];
    let written = cards.zip(names).map(|(block, name)| file(shop.home(), name, &block.text));
    assert_eq!(written.count(), names.len());
    Beside::default()
}

/// Files of the source that a command names.
fn source(shop: &Shop) -> Beside {
    let link = |name: &str| std::os::unix::fs::symlink(root().join(name), shop.home().join(name)).unwrap();
    link("tests");
    let pictures: PathBuf = shop.home().join("docs/pictures");
    std::fs::create_dir_all(pictures).unwrap();
    Beside::default()
}
