use proptest::prelude::*;

use super::*;

fn account(base: i64, share: i64, promised: &[i64]) -> Account {
    Account { promised: promised.to_vec(), share, ..Account::open("here".to_owned(), base) }
}

#[test]
fn what_a_register_means_follows_from_the_account_alone() {
    let moved = |from, to| Finding::Moved { from, to };
    // base, share, promised, found → finding, base, share
    type Case<'a> = (i64, i64, &'a [i64], i64, Finding, i64, i64);
    let cases: [Case<'_>; 12] = [
        (120, 31, &[], 151, Finding::Same, 120, 31),
        (120, 31, &[41], 151, Finding::Same, 120, 31),
        (120, 31, &[41], 161, Finding::Arrived, 120, 41),
        (120, 31, &[41, 36], 156, Finding::Arrived, 120, 36),
        (120, 31, &[], 171, moved(120, 140), 140, 31),
        (120, 31, &[], -9, moved(120, -40), -40, 31),
        (120, 31, &[41], 171, Finding::InQuestion, 120, 31),
        (120, 31, &[], 0, Finding::Restarted, 0, 0),
        (120, 31, &[41], 0, Finding::Restarted, 0, 0),
        // A sum that happens to be zero is what was known.
        (-31, 31, &[], 0, Finding::Same, -31, 31),
        (-41, 31, &[41], 0, Finding::Arrived, -41, 41),
        (0, 0, &[], 55, moved(0, 55), 55, 0),
    ];
    for (base, share, promised, found, finding, base_now, share_now) in cases {
        let mut known = account(base, share, promised);
        assert_eq!(known.find(found, found == 0), finding, "{base} + {share} {promised:?}: {found}");
        assert_eq!(
            (known.base, known.share),
            (base_now, share_now),
            "{base} + {share} {promised:?}: {found}"
        );
    }
}

#[test]
fn an_acknowledged_write_that_reads_back_as_something_else_had_arrived_first() {
    let cases = [
        (161, ReadBack::Verified, 120, 41, 0),
        (151, ReadBack::Ignored, 120, 31, 1),
        (191, ReadBack::Then(Finding::Moved { from: 120, to: 150 }), 150, 41, 0),
        (0, ReadBack::Then(Finding::Restarted), 0, 0, 0),
    ];
    for (found, expected, base, share, promised) in cases {
        let mut known = account(120, 31, &[]).promising(41);
        assert_eq!(known.read_back(41, found, found == 0), expected, "{found}");
        assert_eq!((known.base, known.share, known.promised.len()), (base, share, promised), "{found}");
    }
}

#[test]
fn after_a_restart_only_what_was_known_or_nothing_at_all_is_believed() {
    for (share, promised, found, finding) in [
        (31, &[][..], 151, Finding::Same),
        (31, &[41], 161, Finding::Arrived),
        (31, &[], 0, Finding::Restarted),
        (31, &[], 200, Finding::InQuestion),
        (0, &[41], 200, Finding::InQuestion),
        // Without a share of ours whatever stands there is the operator's.
        (0, &[], 200, Finding::Moved { from: 120, to: 200 }),
    ] {
        let mut known = account(120, share, promised);
        assert_eq!(known.find_rebooted(found, found == 0), finding, "{share} {promised:?} {found}");
        assert_eq!(known.doubt(), (finding == Finding::InQuestion).then_some(Doubt::Rebooted));
    }
}

#[test]
fn what_is_in_question_stays_so_until_a_person_says_that_the_register_is_right() {
    let mut known = account(120, 31, &[41]);
    assert_eq!(known.find(500, false), Finding::InQuestion);
    assert_eq!(known.doubt(), Some(Doubt::Undecidable));
    assert_eq!(known.find(151, false), Finding::InQuestion, "also where it fits again");
    known.confirm(331);
    assert_eq!((known.base(), known.share(), known.doubt(), known.promised().len()), (300, 31, None, 0));
    let mut lost = Account::in_question("here".to_owned(), Doubt::Lost);
    assert_eq!(lost.find(77, false), Finding::InQuestion);
    lost.confirm(77);
    assert_eq!((lost.base(), lost.share()), (77, 0));
}

#[test]
fn a_promise_of_what_stands_or_is_promised_already_adds_nothing() {
    let known = account(120, 31, &[41]);
    assert_eq!(known.promising(31), known);
    assert_eq!(known.promising(41), known);
    assert_eq!(known.promising(21).promised(), [41, 21]);
}

/// Where the gateway ends up in the middle of a change.
#[derive(Clone, Copy, Debug)]
enum Fate {
    KilledBeforeThePromise,
    KilledAfterThePromise,
    KilledAfterTheWrite,
    KilledAfterTheReadBack,
    Refused,
    /// No answer: it never arrived, had arrived, arrives after the next look.
    Lost,
    Unheard,
    Late,
    Ignored,
    Done,
}

#[derive(Clone, Copy, Debug)]
enum Act {
    Change(i64, Fate),
    /// In thousands of counts, so that no edit looks like a share.
    Operator(i64),
    CncRestarts,
    Look,
    Kill,
}

fn acts() -> impl Strategy<Value = Act> {
    use Fate::*;
    let fate = prop::sample::select(vec![
        KilledBeforeThePromise,
        KilledAfterThePromise,
        KilledAfterTheWrite,
        KilledAfterTheReadBack,
        Refused,
        Lost,
        Unheard,
        Late,
        Ignored,
        Done,
        Done,
        Done,
    ]);
    let change = (prop::sample::select(vec![-3, -2, -1, 1, 2, 3]), fate);
    prop_oneof![
        8 => change.prop_map(|(by, fate)| Act::Change(by, fate)),
        2 => prop::sample::select(vec![-2, -1, 1, 2]).prop_map(Act::Operator),
        1 => Just(Act::CncRestarts),
        3 => Just(Act::Look),
        2 => Just(Act::Kill),
    ]
}

/// A register, what is truly in it, and a gateway with a disk.
#[derive(Debug)]
struct World {
    base: i64,
    share: i64,
    disk: Account,
    /// Of a gateway that is alive.
    memory: Option<Account>,
    late: Option<i64>,
    edited_during_a_promise: bool,
}

impl World {
    fn register(&self) -> i64 {
        self.base + self.share
    }

    /// The gateway, started where it was dead, reads the register. `None` where a person had to be asked.
    fn look(&mut self) -> Option<Account> {
        let mut account = self.memory.take().unwrap_or_else(|| self.disk.clone());
        let found = self.register();
        let finding = account.find(found, found == 0);
        if finding == Finding::InQuestion {
            assert!(self.edited_during_a_promise, "asked without need: {self:?} {account:?}");
            // The person does as he was told.
            self.share = account.share();
            account.confirm(self.register());
        }
        self.edited_during_a_promise &= finding != Finding::InQuestion && !account.promised().is_empty();
        assert_eq!((account.base(), account.share()), (self.base, self.share), "{finding:?}");
        self.disk = account.clone();
        self.memory = Some(account.clone());
        (finding == Finding::Same).then_some(account)
    }

    fn change(&mut self, by: i64, fate: Fate) {
        let Some(mut account) = self.look() else { return };
        let share = account.share() + by;
        if matches!(fate, Fate::KilledBeforeThePromise) {
            self.memory = None;
            return;
        }
        self.disk = account.promising(share);
        if matches!(fate, Fate::KilledAfterThePromise) {
            self.memory = None;
            return;
        }
        if matches!(fate, Fate::Refused) {
            self.disk = account;
            return;
        }
        account = account.promising(share);
        self.memory = Some(account.clone());
        match fate {
            Fate::Lost => return,
            Fate::Late => {
                self.late = Some(share);
                return;
            }
            Fate::Ignored => {
                let before = self.register();
                assert_eq!(account.read_back(share, before, before == 0), ReadBack::Ignored);
                self.memory = Some(account);
                return;
            }
            _ => self.share = share,
        }
        match fate {
            Fate::KilledAfterTheWrite => self.memory = None,
            Fate::Unheard => {}
            _ => {
                let found = self.register();
                assert_eq!(account.read_back(share, found, found == 0), ReadBack::Verified);
                self.memory = Some(account.clone());
                if matches!(fate, Fate::KilledAfterTheReadBack) {
                    self.memory = None;
                } else {
                    self.disk = account;
                }
            }
        }
    }

    fn act(&mut self, act: Act) {
        if let Some(late) = self.late.take() {
            self.look();
            self.share = late;
        }
        match act {
            Act::Change(by, fate) => self.change(by, fate),
            Act::Operator(thousands) => {
                self.base += 1000 * thousands;
                let known = self.memory.as_ref().unwrap_or(&self.disk);
                self.edited_during_a_promise |= !known.promised().is_empty();
            }
            Act::CncRestarts => {
                // What an operator enters before the gateway has seen the zero hides it.
                (self.base, self.share) = (0, 0);
                self.look();
            }
            Act::Look => drop(self.look()),
            Act::Kill => self.memory = None,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_share_is_never_lost_nor_doubled_whatever_happens_when(acts in prop::collection::vec(acts(), 1..60)) {
        let disk = Account::open("here".to_owned(), 0);
        let mut world =
            World { base: 0, share: 0, disk, memory: None, late: None, edited_during_a_promise: false };
        for act in acts {
            world.act(act);
        }
        world.look();
    }
}
