//! Recipes of the manual for chat services. They post to a server that checks each message as its service does.

use std::path::Path;

use isotherm::observe::events::{Change, Delivery, Event, ReportedEvent};
use isotherm::observe::notify::{Outboxes, Rules};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;
use serde_json::Value;

use super::*;

const GRINDER: &str = include_str!("../../profile/grinder.toml");
const CHAPTER: &str = include_str!("../../../docs/notify.md");

/// Recipes: the blocks of the chapter with a `body` and a token.
fn recipes() -> Vec<&'static str> {
    let blocks = CHAPTER.split("```toml,part\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    blocks.filter(|block| block.contains("\nbody ") && block.contains("\ntoken_file ")).collect()
}

/// Starts the server. Returns it and its port.
fn chats() -> (Running, u16) {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    assert!(
        python.exists(),
        "jsonschema is not installed at {}: `tests/run tools` does it",
        python.display()
    );
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/chats.py");
    let mut chats = Running::start(Command::new(python).arg(script));
    let port = chats.receives("at ").trim_start_matches("at ").parse().unwrap();
    (chats, port)
}

/// Profile with this recipe. Its address is that of the server, and its token file has this token.
fn profile(home: &Path, recipe: &str, port: u16, token: &str) -> Profile {
    let (before, rest) = recipe.split_once("https://").unwrap();
    let (_, path) = rest.split_once('/').unwrap();
    let text = format!("{GRINDER}\n{before}http://127.0.0.1:{port}/{path}");
    let loaded = isotherm_profile::parse(Path::new("machine.toml"), &text, &[], &[]);
    let mut profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(profile.notify.len(), 1, "{recipe}");
    let path = file(home, "chat.token", token);
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600)).unwrap();
    profile.notify[0].token_file = Some(path);
    profile
}

#[tokio::test]
async fn each_recipe_is_accepted_by_its_service_and_shows_the_event() {
    let (mut chats, port) = chats();
    let home = tempfile::tempdir().unwrap();
    let fault = "the device answered \"no\" \\ {machine} <b> µm\u{1b}";
    let event = Event::WriteFailed { output: "cnc_z".into(), fault: fault.into() };
    let entry = event.entry(Moment::default());
    let (shown, level) = (&entry.text, entry.level.name());
    assert!(shown.contains("\"no\" \\ {machine} <b> µm\\u001b"), "{shown}");
    let services = [
        ("slack", "T0/B1/secret", 200, format!("grinder-1: {shown}")),
        ("teams", "secret", 202, format!("grinder-1\n{shown}")),
        ("ntfy", "tk_secret", 200, format!("grinder-1 [{level}] {shown}")),
    ];
    let recipes = recipes();
    assert_eq!(recipes.len(), services.len());
    for (recipe, (service, token, code, expected)) in recipes.into_iter().zip(services) {
        let profile = profile(home.path(), recipe, port, token);
        let outboxes = Outboxes::of(&profile, false);
        let receives = outboxes.listener().unwrap();
        let report =
            Arc::new(|delivery: Delivery| assert_eq!(format!("{delivery:?}"), "nothing is reported"));
        let posting = outboxes.posted(report, Rules::default(), |_| Err("nobody is trusted".to_owned()));
        let posting = posting.unwrap().unwrap();
        let change = Change { raised: Some("output cnc_z".into()), ended: Vec::new() };
        receives(ReportedEvent { event: &event, entry: &entry, change: &change });
        let line: Value = serde_json::from_str(&chats.receives("\"service\"")).unwrap();
        assert_eq!(line["service"], service, "{line}");
        assert_eq!((&line["code"], &line["shown"]), (&code.into(), &expected.into()), "{line}");
        // The server prints its line before it answers.
        posting.finish(std::future::pending()).await;
    }
}

/// Without `body`, these services reject the document. The server above therefore checks messages.
#[tokio::test]
async fn without_a_body_each_service_rejects_the_message_with_a_hint() {
    let (mut chats, port) = chats();
    let home = tempfile::tempdir().unwrap();
    for (recipe, token) in recipes().into_iter().zip(["T0/B1/secret", "secret", "tk_secret"]) {
        let profile = profile(home.path(), recipe, port, token);
        let server = Server::of(&profile.notify[0], Err("nobody is trusted".to_owned()));
        let failure = server.post("{\"machine\":\"grinder-1\",\"kind\":\"started\"}").await.unwrap_err();
        assert!(failure.to_string().contains("another format, set `body`"), "{failure}");
        let line: Value = serde_json::from_str(&chats.receives("\"service\"")).unwrap();
        assert_eq!(line["code"], 400, "{line}");
    }
}
