//! `[opcua_server]`: who may log in and read, with errors, warnings and preview.

use std::time::Duration;

use isotherm_profile::preview::Preview;
use isotherm_profile::{AnonymousClients, Security, ServerLogin};

use super::*;

/// Files next to the profile. Their content is not checked here.
const FILES: [(&str, &[u8]); 6] = [
    ("server.der", b"certificate"),
    ("server.pem", b"key"),
    ("mes.password", b"hot-and-cold\n"),
    ("probe.der", b"certificate"),
    ("clients/mes.der", b"certificate"),
    ("clients/probe.crt", b"certificate"),
];
const SECURED: &str = "security = \"sign-and-encrypt\"\ncert = \"server.der\"\nkey = \"server.pem\"\n\
                       trusted = \"clients\"\n";
const USERS: &str = "users = [{ name = \"mes\", password_file = \"mes.password\" }, \
                     { name = \"probe\", cert = \"probe.der\", commands = [\"measured\"] }]\n";

fn served(lines: &str) -> Result<Loaded, Errors> {
    let text = GRINDER.replacen("[history]", &format!("[opcua_server]\n{lines}\n\n[history]"), 1);
    isotherm_profile::parse_with(Path::new("machine.toml"), &text, &FILES, &[], &[])
}

#[test]
fn what_is_not_said_has_its_usual_value() {
    let loaded = served("security = \"none\"\nanonymous = true").unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let server = loaded.profile.opcua_server.unwrap();
    assert_eq!((server.listen.as_str(), server.every), ("127.0.0.1:4840", Duration::from_secs(1)));
    assert_eq!((server.security, server.anonymous), (Security::None, AnonymousClients::Allowed));
    assert!(server.own.is_none() && server.users.is_empty() && server.trusted.is_empty());
}

#[test]
fn a_secured_server_has_its_files_its_users_and_their_commands() {
    let all = format!("listen = \"0.0.0.0:4841\"\n{SECURED}{USERS}every = \"100ms\"\n");
    let loaded = served(&all).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let profile = loaded.profile;
    let server = profile.opcua_server.as_ref().unwrap();
    let [mes, probe] = server.users.as_slice() else { panic!("{:?}", server.users) };
    assert!(matches!(&mes.login, ServerLogin::Password(file) if file.name == "mes.password"));
    assert!(matches!(&probe.login, ServerLogin::Certificate(file) if file.name == "probe.der"));
    assert!(!mes.takes_measured && probe.takes_measured);
    assert_eq!(server.anonymous, AnonymousClients::Refused);
    let secrets: Vec<&str> = server.secrets().map(|file| file.name.as_str()).collect();
    assert_eq!(secrets, ["server.pem", "mes.password"]);
    assert!(!format!("{profile:?}").contains("hot-and-cold"), "a secret is shown");
    let said = Preview::of(&profile).to_string();
    for line in [
        "\nserves\n",
        "  OPC UA server at opc.tcp://0.0.0.0:4841: messages are signed and encrypted\n",
        "    own certificate server.der; trusts the clients in clients: clients/mes.der, clients/probe.crt\n",
        "    users: mes (password), probe (certificate probe.der, may send measured errors); clients without a \
         user are refused\n",
        "    all nodes are read only, and are updated every 100ms\n",
    ] {
        assert!(said.contains(line), "{line}\n{said}");
    }
    let json = serde_json::to_value(Preview::of(&profile)).unwrap();
    assert_eq!(json["opcua_server"]["security"], "sign-and-encrypt");
    assert_eq!(json["opcua_server"]["anonymous"], "refused");
}

#[test]
fn what_is_wrong_with_it_is_said_at_its_key() {
    let open = "security = \"none\"\nanonymous = true\n";
    let user = |user: &str| format!("security = \"none\"\nusers = [{user}]");
    for (lines, key, words) in [
        ("anonymous = true".to_owned(), "opcua_server.security", "`security` is missing"),
        ("security = \"none\"".to_owned(), "opcua_server", "no client may log in"),
        (format!("{open}listen = \"4840\""), "opcua_server.listen", "not a host with a port"),
        (format!("{open}listen = \"0.0.0.0:99999\""), "opcua_server.listen", "not a host with a port"),
        (format!("{open}every = \"10ms\""), "opcua_server.every", "does not update the nodes this often"),
        (format!("{open}cert = \"server.der\""), "opcua_server.cert", "only for a secured server"),
        (format!("{open}trusted = \"clients\""), "opcua_server.trusted", "only for a secured server"),
        ("security = \"sign\"\nanonymous = true".to_owned(), "opcua_server.cert", "`cert` is missing"),
        ("security = \"sign\"\nanonymous = true".to_owned(), "opcua_server.trusted", "which clients"),
        (user("{ name = \"mes\" }"), "opcua_server.users[0]", "no password and no certificate"),
        (
            user("{ name = \"mes\", password_file = \"mes.password\", cert = \"probe.der\" }"),
            "opcua_server.users[0]",
            "either a password or a certificate",
        ),
        (
            user("{ name = \"mes\", cert = \"probe.der\" }"),
            "opcua_server.users[0].cert",
            "only for a secured server",
        ),
        (
            user("{ name = \"ANONYMOUS\", password_file = \"mes.password\" }"),
            "opcua_server.users[0].name",
            "cannot be the name of a user",
        ),
        (
            user(
                "{ name = \"a\", password_file = \"mes.password\" }, { name = \"a\", password_file = \"mes.password\" }",
            ),
            "opcua_server.users[1].name",
            "listed twice",
        ),
        (
            user("{ name = \"mes\", password_file = \"none.password\" }"),
            "opcua_server.users[0].password_file",
            "none.password",
        ),
    ] {
        let found = errors(served(&lines));
        let one = found.iter().find(|error| error.key == key);
        let one = one.unwrap_or_else(|| panic!("{lines}\n{}", Errors(found.clone())));
        assert!(one.message.contains(words) && one.help.is_some(), "{lines}: {one}");
    }
}

#[test]
fn no_command_arms_disarms_or_moves() {
    for word in ["arm", "disarm", "zero", "sign", "write"] {
        let user = format!("{{ name = \"mes\", password_file = \"mes.password\", commands = [\"{word}\"] }}");
        let found = errors(served(&format!("security = \"none\"\nusers = [{user}]")));
        assert!(found[0].to_string().contains("measured"), "{}", found[0]);
    }
}

#[test]
fn what_others_can_read_or_forge_is_warned_of() {
    let user = "users = [{ name = \"mes\", password_file = \"mes.password\" }]";
    let open = "security = \"none\"\nanonymous = true";
    for (lines, words) in [
        (format!("listen = \"0.0.0.0:4840\"\n{open}"), Some("can read all values")),
        (format!("listen = \"0.0.0.0:4840\"\nsecurity = \"none\"\n{user}"), Some("read the passwords")),
        (open.to_owned(), None),
        (format!("listen = \"0.0.0.0:4840\"\n{SECURED}{user}"), None),
        (format!("{}{user}", SECURED.replace("clients", "nobody")), Some("no client is trusted")),
    ] {
        let warnings = served(&lines).unwrap_or_else(|errors| panic!("{errors}")).warnings;
        let of_it = warnings.iter().filter(|warning| warning.key.starts_with("opcua_server"));
        let said: Vec<&str> = of_it.map(|warning| warning.message.as_str()).collect();
        match words {
            Some(words) => assert!(said.len() == 1 && said[0].contains(words), "{lines}: {said:?}"),
            None => assert!(said.is_empty(), "{lines}: {said:?}"),
        }
    }
}
