use super::*;

const GRINDER: &str = include_str!("../../../../profiles/surface-grinder.toml");

fn profile() -> Profile {
    let mut profile = crate::profile::parse(Path::new("grinder.toml"), GRINDER, &[], &[]).unwrap().profile;
    profile.outputs.iter_mut().for_each(|output| output.share = Share::Ledger);
    profile
}

fn found(directory: &Path, profile: &Profile) -> (Accounts, Option<String>) {
    let found = open(directory, profile, |_| false);
    (found.accounts, found.trouble)
}

/// A file with an account of every output, share 31.
fn kept(directory: &Path, profile: &Profile) -> Accounts {
    let mut book = open(directory, profile, |_| false).book;
    let mut accounts = Accounts::new();
    for output in &profile.outputs {
        let mut account = Account::open(register(profile, output), 120).promising(31);
        account.find(151, false);
        accounts.insert(output.name.clone(), account);
    }
    book.save(&accounts).unwrap();
    accounts
}

#[test]
fn what_is_kept_is_found_again() {
    let directory = tempfile::tempdir().unwrap();
    let profile = profile();
    assert_eq!(found(directory.path(), &profile), (Accounts::new(), None));
    let accounts = kept(directory.path(), &profile);
    assert_eq!(found(directory.path(), &profile), (accounts, None));
}

#[test]
fn a_file_that_cannot_be_used_puts_every_share_in_question_and_is_kept_aside_before_it_is_replaced() {
    let profile = profile();
    let name = format!("{}.ledger.json", profile.name);
    let whole = {
        let directory = tempfile::tempdir().unwrap();
        kept(directory.path(), &profile);
        std::fs::read_to_string(directory.path().join(&name)).unwrap()
    };
    let half = whole[..whole.len() / 2].to_owned();
    let later = whole.replace("\"version\": 1", "\"version\": 9");
    let huge = whole.replace("\"share\": 31", "\"share\": 9223372036854775807");
    for spoilt in [half.as_str(), later.as_str(), huge.as_str(), "", "{}"] {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join(&name), spoilt).unwrap();
        for _ in 0..2 {
            let (accounts, trouble) = found(directory.path(), &profile);
            assert!(trouble.is_some_and(|why| why.contains(&name)), "{spoilt}");
            assert_eq!(accounts.len(), profile.outputs.len());
            assert!(
                accounts
                    .values()
                    .all(|account| account.doubt == Some(Doubt::Unreadable) && account.share == 0)
            );
        }
        let mut opened = open(directory.path(), &profile, |_| false);
        opened.book.save(&opened.accounts).unwrap();
        assert_eq!(
            std::fs::read_to_string(directory.path().join(&name).with_extension("json.bad")).unwrap(),
            spoilt
        );
        let (accounts, trouble) = found(directory.path(), &profile);
        assert!(trouble.is_none() && accounts == opened.accounts, "the question outlives the file");
    }
}

#[test]
fn a_ledger_that_is_gone_while_the_state_remembers_an_offset_is_a_question() {
    let directory = tempfile::tempdir().unwrap();
    let profile = profile();
    let accounts = open(directory.path(), &profile, |_| true).accounts;
    assert!(accounts.values().all(|account| account.doubt == Some(Doubt::Lost)));
    assert_eq!(accounts.len(), profile.outputs.len());
}

#[test]
fn an_account_goes_with_its_register_not_with_its_name() {
    let directory = tempfile::tempdir().unwrap();
    let mut profile = profile();
    let accounts = kept(directory.path(), &profile);
    let former = profile.outputs[0].name.clone();
    profile.outputs[0].name = "renamed".to_owned();
    assert_eq!(found(directory.path(), &profile).0["renamed"], accounts[&former]);
    let scale = &mut profile.outputs[0].encoding.scale;
    *scale = crate::codec::Scale::of(2.0 * scale.get());
    profile.outputs[0].name.clone_from(&former);
    let elsewhere = &found(directory.path(), &profile).0[&former];
    assert_eq!((elsewhere.doubt, elsewhere.share), (Some(Doubt::Elsewhere), 0));
}
