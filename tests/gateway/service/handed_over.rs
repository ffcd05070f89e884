//! Handover from one program to the next in the same process. The next one accepts nothing that another process has
//! made.

use std::fs::{File, Permissions};
use std::io::Write;
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};
use serde_json::{Value, json};

use crate::service::process::{Running, until};
use crate::service::rig::{Service, corrected};

/// Shell that becomes the program when the file for its standard input has been named.
const BECOMES: [&str; 3] = ["/bin/sh", "-c", "read -r file; exec \"$0\" \"$@\" < \"$file\""];
/// Script that becomes the program, with memfd_create refused as by an old kernel or a filter of system calls.
const WITHOUT_MEMFD: &str = r#"
import ctypes, os, platform, struct, sys
number = {"x86_64": 319, "aarch64": 279}[platform.machine()]
program = [(0x20, 0, 0, 0), (0x15, 0, 1, number), (0x06, 0, 0, 0x00050001), (0x06, 0, 0, 0x7fff0000)]
code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *one) for one in program))
filter = ctypes.create_string_buffer(struct.pack("HxxxxxxP", len(program), ctypes.addressof(code)))
libc = ctypes.CDLL(None, use_errno=True)
assert libc.prctl(38, 1, 0, 0, 0) == 0 and libc.prctl(22, 2, filter, 0, 0) == 0
os.execv(sys.argv[1], sys.argv[1:])
"#;
/// Handover that the environment could pass in an earlier version.
const HANDOVER: &str = r#"{"by":"by maria","armed":{"z":39.0},"off":{}}"#;

fn manual(text: &str) -> String {
    text.replace("arm = \"auto\"", "arm = \"manual\"")
}

fn digest(state: &Path) -> PathBuf {
    state.join("walker.handover")
}

/// Document that a gateway would hand over in the process with this number.
fn document(process: u32) -> Value {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    let started: u64 = stat.rsplit(')').next().unwrap().split_whitespace().nth(19).unwrap().parse().unwrap();
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap();
    let handover: Value = serde_json::from_str(HANDOVER).unwrap();
    json!({ "process": { "id": process, "started": started, "boot": boot.trim() }, "handover": handover })
}

/// Starts a gateway with manual arming, with a memfd of these bytes and seals. Its digest is written if
/// `leaves_digest`.
fn started_with(seals: SealFlags, bytes: impl Fn(u32) -> Vec<u8>, leaves_digest: bool) -> Service {
    let mut file = File::from(
        memfd_create("isotherm-handover", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING).unwrap(),
    );
    let give = |gateway: &mut Running, state: &Path| {
        let bytes = bytes(gateway.id());
        file.write_all(&bytes).unwrap();
        file.set_permissions(Permissions::from_mode(0o400)).unwrap();
        fcntl_add_seals(&file, seals).unwrap();
        std::fs::create_dir_all(state).unwrap();
        if leaves_digest {
            std::fs::write(digest(state), isotherm_profile::sha256(&bytes)).unwrap();
        }
        let path = format!("/proc/{}/fd/{}\n", std::process::id(), file.as_raw_fd());
        gateway.stdin().write_all(path.as_bytes()).unwrap();
    };
    Service::start_by(|text| manual(&corrected(&text)), &BECOMES, &[], give)
}

const ALL: SealFlags =
    SealFlags::SEAL.union(SealFlags::SHRINK).union(SealFlags::GROW).union(SealFlags::WRITE);

/// Checks that the axis is off, the readout is not written, and the event contains the reason.
#[track_caller]
fn is_refused(service: &Service, why: &str) {
    service.device.asks(100);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((service.device.offset(), service.device.state().writes()), (0, 0));
    let refused = service.events("handover-refused");
    assert_eq!(refused.len(), usize::from(!why.is_empty()), "{refused:#?}");
    for event in &refused {
        let text = event["text"].as_str().unwrap();
        assert!(text.contains(why) && text.contains("arm the axes that are off"), "{text}");
    }
    assert!(service.events("armed").is_empty());
    assert!(!digest(&service.home.path().join("state")).exists());
    assert_eq!(standard_input(&service.gateway).ends_with("null"), !why.is_empty());
}

fn standard_input(gateway: &Running) -> PathBuf {
    std::fs::read_link(format!("/proc/{}/fd/0", gateway.id())).unwrap()
}

#[test]
fn a_forged_variable_of_the_environment_arms_nothing_and_moves_no_readout() {
    let forged = [("ISOTHERM_HANDOVER", HANDOVER)];
    let service = Service::start_by(|text| manual(&corrected(&text)), &[], &forged, |_, _| ());
    is_refused(&service, "");
}

#[test]
fn a_handover_of_another_process_is_refused_and_one_that_can_be_changed() {
    let whole = |process| document(process).to_string().into_bytes();
    let of_another = |_| whole(std::process::id());
    is_refused(&started_with(ALL, of_another, true), "another process wrote the handover");
    is_refused(&started_with(ALL.difference(SealFlags::WRITE), whole, true), "not sealed");
    let cut = |process| whole(process)[..40].to_vec();
    is_refused(&started_with(ALL, cut, true), "cannot read the format");
}

#[test]
fn a_handover_is_used_once() {
    let whole = |process| document(process).to_string().into_bytes();
    // The handover has everything that a gateway writes. A program that may write to the state directory as the same
    // user can make one.
    let service = started_with(ALL, whole, true);
    until("it is armed", || match service.events("armed").as_slice() {
        [armed] if armed["data"]["way"] == "restart" && armed["data"]["from_um"] == 39.0 => Ok(()),
        found => Err(format!("{found:?}")),
    });
    assert!(!digest(&service.home.path().join("state")).exists());
    assert!(standard_input(&service.gateway).ends_with("null"));
    is_refused(&started_with(ALL, whole, false), "the handover was used before");
}

#[test]
fn a_digest_without_a_handover_is_an_event_and_the_start_an_ordinary_one() {
    let announce = |_: &mut Running, state: &Path| {
        std::fs::create_dir_all(state).unwrap();
        std::fs::write(digest(state), "0").unwrap();
    };
    let wait = [
        "/bin/sh",
        "-c",
        "while [ ! -e \"$HOME/state/walker.handover\" ]; do sleep 0.05; done; exec \"$0\" \"$@\" < /dev/null",
    ];
    let service =
        Service::start_by(|text| manual(&corrected(&text)), &wait, &[("PATH", "/usr/bin:/bin")], announce);
    is_refused(&service, "has received none");
}

#[test]
fn an_ordinary_restart_warns_of_nothing_and_leaves_nothing_open() {
    let mut service = Service::start(|text| text);
    service.walks_to(50);
    for _ in 0..3 {
        let (code, said) = service.restart(&[]);
        assert_eq!(code, Some(0), "{said}");
        assert!(!said.contains("warning") && !said.contains("environment"), "{said}");
        assert!(standard_input(&service.gateway).ends_with("null"));
        let of_process = PathBuf::from(format!("/proc/{}", service.gateway.id()));
        let open = std::fs::read_dir(of_process.join("fd")).unwrap();
        let links = open.filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok());
        let links: Vec<PathBuf> =
            links.filter(|link| link.to_string_lossy().contains("memfd:isotherm-handover")).collect();
        assert!(links.is_empty(), "{links:?}");
        let environment = std::fs::read(of_process.join("environ")).unwrap();
        assert!(!String::from_utf8_lossy(&environment).contains("ISOTHERM"));
        assert!(!digest(&service.home.path().join("state")).exists());
    }
    let said = service.gateway.so_far();
    assert!(!said.iter().any(|line| line.contains("environment") || line.contains("ISOTHERM")), "{said:#?}");
    assert!(service.events("handover-refused").is_empty());
    assert_eq!((service.events("armed").len(), service.device.offset()), (4, 50));
}

#[test]
fn without_a_memfd_or_with_a_full_state_directory_the_old_gateway_goes_on_and_says_why() {
    let path = std::env::var("PATH").unwrap();
    let by = ["/usr/bin/env", "python3", "-c", WITHOUT_MEMFD];
    let mut service = Service::start_by(|text| text, &by, &[("PATH", path.as_str())], |_, _| ());
    resumes(&mut service, "cannot create a sealed memfd (Operation not permitted)");
    let mut service = Service::start(|text| text);
    // A file cannot replace a directory.
    std::fs::create_dir(service.home.path().join("state/walker.handover.rehearsal")).unwrap();
    resumes(&mut service, "walker.handover.rehearsal");
}

#[track_caller]
fn resumes(service: &mut Service, why: &str) {
    service.walks_to(50);
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains(why) && said.contains("the gateway continues as before"), "{said}");
    let refused = service.events("command-refused");
    assert!(refused.len() == 1 && refused[0]["text"].as_str().unwrap().contains(why), "{refused:#?}");
    assert_eq!(service.events("started").len(), 1);
    service.walks_to(80);
    assert!(!service.gateway.has_ended());
}

/// With 1,300 axes the handover is longer than an argument of a program may be. `TEST_AXES=5000` sets another number.
#[test]
fn thousands_of_axes_that_are_off_stay_off() {
    use std::fmt::Write;
    let count = std::env::var("TEST_AXES").map_or(1300, |text| text.parse().unwrap());
    let many = |mut text: String| {
        for axis in 0..count {
            // The names are so long that together they exceed an argument of a program.
            write!(
                text,
                "[axis.{name}]\nlimit = 20.0\nstep = 1.0\nrate = 10.0\nevery = \"10s\"\non_fault = {{ action = \"hold\" }}\n\
                 [[axis.{name}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
                 terms = [{{ signal = \"bed\", gain = 0.1, reference = 0.0 }}]\n",
                name = format!("axis_{axis:05}_{}", "of_a_machine_that_has_a_great_many_".repeat(3))
            )
            .unwrap();
        }
        text
    };
    let service = Service::start(many);
    assert_eq!(service.verb(&["disarm"]).status.code(), Some(0));
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{}", &said[..said.len().min(2000)]);
    let status: Value = serde_json::from_slice(&service.verb(&["status", "--json"]).stdout).unwrap();
    let axes = status["axes"].as_object().unwrap();
    let is_off = |axis: &&Value| axis["why"].as_str().unwrap().starts_with("switched off by a person");
    assert_eq!(axes.values().filter(is_off).count(), count + 1);
    assert_eq!((service.events("armed").len(), service.events("handover-refused").len()), (count + 1, 0));
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(service.events("started").len(), 2);
}

#[test]
fn an_axis_that_got_its_model_after_a_sign_check_is_armed_as_the_profile_says() {
    let mut whole = String::new();
    let service = Service::start(|text| {
        whole.clone_from(&text);
        let (before, behind) = text.split_once("[[axis.z.model]]").unwrap();
        let (_, output) = behind.split_once("[output.cnc_z]").unwrap();
        format!("{before}[output.cnc_z]{output}")
    });
    let checked = service.verb(&["sign", "--axis", "z", "--answer", "plus"]);
    assert!(checked.status.success(), "{checked:?}");
    service.rewrite(|_| whole);
    until("the new program runs", || match service.restart(&[]) {
        (Some(0), _) => Ok(()),
        (_, said) => {
            assert!(!said.contains("end the sign check first"), "the check was answered: {said}");
            Err(said)
        }
    });
    service.walks_to(30);
}
