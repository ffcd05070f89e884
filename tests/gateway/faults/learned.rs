//! Learned models: proposed, adopted and taken back while the machine runs. Cz never jumps, and the log gives it all
//! again.

use std::path::Path;
use std::time::Duration;

use isotherm::cli::replay::replay;
use isotherm::gateway::{Files, LearnCommand, LearnTimes, Options, candidates, superseded_in};
use isotherm::observe::status::{Command, LearnedStatus};
use isotherm_core::candidate::{JudgedDay, Judgement, Offer, OfferedTerm};
use isotherm_core::quantity::Moment;

use crate::faults::law;
use crate::faults::rig::{BENCH, Sample, Stage, Trace, World, block_on, profile, somebody};

const MINUTE: Duration = Duration::from_secs(60);

/// The bench with an axis that learns.
fn learning(adopt: &str) -> String {
    let patient = BENCH.replace("100ms", "900ms");
    format!(
        "{patient}
        [axis.z.probe]
        limit = 40.0
        filter = 0.5
        max_error = 200.0
        learn = \"daily\"
        {adopt}"
    )
}

/// Candidate that leaves 3.8 instead of `in_use` µm.
fn offer(name: &str, in_use: f64) -> Offer {
    let mut judgement = Judgement::default();
    let begins = Moment::from_nanos(1_767_571_200_000_000_000);
    assert!(judgement.judge(JudgedDay { begins, touches: 8, in_use: in_use * in_use, candidate: 3.8 * 3.8 }));
    let term =
        |signal: &str, lag_s, gain| OfferedTerm { signal: signal.to_owned(), lag_s, squared: false, gain };
    Offer {
        axis: "z".to_owned(),
        name: name.to_owned(),
        runs: 9,
        terms: vec![term("bed", 0.0, 1.5), term("bed", 360.0, 0.4), term("wheelhead", 0.0, -1.1)],
        judgement,
        compared_with: None,
        own: profile(&learning("")).axes[0].settings.learned.as_ref().unwrap().own.clone(),
    }
}

fn write(directory: &Path, offer: &Offer) {
    candidates::write(&Files, (directory, "bench"), "z", Some(offer)).unwrap();
}

fn in_directory(directory: &Path) -> impl FnOnce(&mut Options) {
    let directory = Some(directory.to_owned());
    move |options| options.directory = directory
}

fn learned(sample: &Sample) -> &LearnedStatus {
    sample.status.axes[0].learned.as_ref().unwrap()
}

/// Largest change of the requested Cz between two samples in this time, µm.
fn largest_step(trace: &Trace, from: u64, to: u64) -> f64 {
    let raw: Vec<f64> = trace.between(from, to).filter_map(|sample| sample.status.axes[0].raw_um).collect();
    raw.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max)
}

#[test]
fn a_person_adopts_a_model_that_survives_a_restart_and_takes_it_back_and_the_log_gives_it_all_again() {
    let directory = tempfile::tempdir().unwrap();
    let text = learning("");
    write(directory.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let (first, second) = block_on(async {
        let mut world = World::new(&text, "").await;
        let first = world.gateway().options(in_directory(directory.path()));
        let first = first.command(6 * MINUTE, Command::Adopt).run(9 * MINUTE).await;
        let second = world.gateway().options(in_directory(directory.path()));
        (first, second.command(4 * MINUTE, Command::AdoptBack).run(7 * MINUTE).await)
    });
    law::holds(&first);
    law::holds(&second);
    assert_eq!(first.reported("candidate-better"), 1, "{}", first.lines());
    let proposed = first.between(299, 301).next().unwrap();
    let candidate = learned(proposed).candidate.clone().unwrap();
    assert!(candidate.better && candidate.in_use_um == Some(6.9), "{candidate:?}");
    assert_eq!(
        (learned(proposed).adopted.as_deref(), proposed.status.axes[0].model.as_deref()),
        (None, Some("difference"))
    );

    let adopted = first.samples.last().unwrap();
    assert_eq!(learned(adopted).adopted.as_deref(), Some("learned-2026-01-05-3fa2"), "{}", first.lines());
    assert_eq!(adopted.status.axes[0].model.as_deref(), Some("learned"));
    assert_eq!(first.reported("model-adopted"), 1, "{}", first.lines());
    assert!(largest_step(&first, 355, 370) < 0.5, "{}", largest_step(&first, 355, 370));
    assert_eq!(first.states(), ["waiting", "active"], "the adopted model is no fallback");

    let after = &second.samples[1];
    assert_eq!(learned(after).adopted.as_deref(), Some("learned-2026-01-05-3fa2"), "kept over the restart");
    let back = second.samples.last().unwrap();
    assert_eq!(
        (learned(back).adopted.as_deref(), back.status.axes[0].model.as_deref()),
        (None, Some("difference"))
    );
    assert_eq!(learned(back).before.as_deref(), Some("learned-2026-01-05-3fa2"));
    assert!(largest_step(&second, 235, 250) < 0.5, "{}", largest_step(&second, 235, 250));

    let log = std::fs::File::open(directory.path().join("bench-2026-01-05.csv")).unwrap();
    let summary = replay(&profile(&text), log, "the day", None).unwrap();
    let axis = &summary.axes["z"];
    assert_eq!(axis.reproduced.as_ref().unwrap().first, None, "{summary}");
    assert_eq!(axis.learned, ["learned-2026-01-05-3fa2"], "{summary}");
    // Another model in the profile: the learned one does not belong to it.
    let other = profile(&text.replacen("gain = 2.0", "gain = 2.1", 1));
    let log = std::fs::File::open(directory.path().join("bench-2026-01-05.csv")).unwrap();
    let summary = replay(&other, log, "the day", None).unwrap();
    assert_eq!(summary.axes["z"].learned, Vec::<String>::new());
    assert!(
        summary.warnings.iter().any(|warning| warning.contains("the profile had other models")),
        "{summary}"
    );
}

#[test]
fn a_candidate_that_is_not_better_or_was_compared_with_another_model_is_not_adopted() {
    let directory = tempfile::tempdir().unwrap();
    let adopt = |words: &'static str| {
        move |stage: &Stage<'_>| {
            let why = stage.source.command(Command::Adopt, Some("z"), &somebody()).unwrap_err();
            assert!(why.contains(words), "`{words}` is not in: {why}");
        }
    };
    let other = Offer { compared_with: Some("learned-2025".to_owned()), ..offer("b", 6.9) };
    for (offer, words) in [
        (None, "no candidate has been learned yet"),
        (
            Some(offer("a", 3.7)),
            "the candidate is not better: it would have left a residual error of 3.8 µm instead of 3.7 µm",
        ),
        (Some(other), "was compared with another model"),
        (
            Some(Offer { judgement: Judgement::default(), ..offer("c", 6.9) }),
            "has not been compared with the model in use yet",
        ),
    ] {
        offer.iter().for_each(|offer| write(directory.path(), offer));
        let trace = block_on(async {
            let mut world = World::new(&learning(""), "").await;
            let trial = world.gateway().options(in_directory(directory.path()));
            trial.at(MINUTE, adopt(words)).run(MINUTE + MINUTE / 2).await
        });
        assert_eq!((trace.reported("candidate-better"), trace.reported("model-adopted")), (0, 0), "{words}");
    }
}

#[test]
fn a_better_candidate_is_adopted_by_itself_at_a_datum_only() {
    let directory = tempfile::tempdir().unwrap();
    // The references of the bench are numbers. A zero gives it a datum.
    let text = learning("adopt = \"auto\"").replacen("[axis.z]", "[axis.z]\ndatum = \"zero\"", 1);
    write(directory.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let trial = world.gateway().options(in_directory(directory.path()));
        trial.command(6 * MINUTE, Command::Zero).run(9 * MINUTE).await
    });
    law::holds(&trace);
    let waiting = learned(trace.between(349, 351).next().unwrap());
    assert_eq!(
        (waiting.adopted.as_deref(), waiting.waiting.as_deref()),
        (None, Some("learned-2026-01-05-3fa2"))
    );
    let adopted = learned(trace.samples.last().unwrap());
    assert_eq!(
        (adopted.adopted.as_deref(), adopted.waiting.as_deref()),
        (Some("learned-2026-01-05-3fa2"), None)
    );
    assert_eq!(trace.reported("model-adopted"), 1, "{}", trace.lines());
}

#[test]
fn a_change_that_waits_is_withdrawn_by_the_way_back() {
    let directory = tempfile::tempdir().unwrap();
    let text = learning("adopt = \"auto\"").replacen("[axis.z]", "[axis.z]\ndatum = \"zero\"", 1);
    write(directory.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let (first, second) = block_on(async {
        let mut world = World::new(&text, "").await;
        let first = world.gateway().options(in_directory(directory.path()));
        let first = first.command(3 * MINUTE, Command::AdoptBack).command(6 * MINUTE, Command::Zero);
        let first = first.run(9 * MINUTE).await;
        // The gateway takes the same candidate again.
        let second = world.gateway().options(in_directory(directory.path()));
        (first, second.command(3 * MINUTE, Command::Zero).run(6 * MINUTE).await)
    });
    for trace in [&first, &second] {
        assert_eq!(trace.reported("model-adopted"), 0, "{}", trace.lines());
        let last = learned(trace.samples.last().unwrap());
        assert_eq!((last.waiting.as_deref(), last.auto), (None, false));
        assert!(last.candidate.as_ref().is_some_and(|candidate| candidate.better), "a person may adopt it");
    }
}

#[test]
fn a_model_that_a_person_took_back_is_not_adopted_again_by_itself() {
    let directory = tempfile::tempdir().unwrap();
    let text = learning("adopt = \"auto\"").replacen("[axis.z]", "[axis.z]\ndatum = \"zero\"", 1);
    write(directory.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let (first, second) = block_on(async {
        let mut world = World::new(&text, "").await;
        let first = world.gateway().options(in_directory(directory.path()));
        let first = first.command(6 * MINUTE, Command::Zero).command(8 * MINUTE, Command::AdoptBack);
        let first = first.run(9 * MINUTE).await;
        let second = world.gateway().options(in_directory(directory.path()));
        (first, second.command(3 * MINUTE, Command::Zero).run(6 * MINUTE).await)
    });
    assert_eq!(first.reported("model-adopted"), 2, "{}", first.lines());
    assert_eq!(second.reported("model-adopted"), 0, "{}", second.lines());
    let last = learned(second.samples.last().unwrap());
    assert_eq!((last.adopted.as_deref(), last.waiting.as_deref(), last.auto), (None, None, false));
    assert!(last.candidate.as_ref().is_some_and(|candidate| candidate.better), "a person may adopt it");
}

#[test]
fn a_learned_model_of_other_models_of_the_profile_is_not_used_and_reported() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let second = block_on(async {
        let mut world = World::new(&learning(""), "").await;
        let first = world.gateway().options(in_directory(directory.path()));
        first.command(2 * MINUTE, Command::Adopt).run(3 * MINUTE).await;
        assert!(superseded_in(directory.path(), &world.profile).is_empty());
        world.profile.axes[0].settings.learned.as_mut().unwrap().own = "other models".to_owned();
        let superseded = superseded_in(directory.path(), &world.profile);
        assert_eq!(superseded, [("z".to_owned(), "learned-2026-01-05-3fa2".to_owned())]);
        world.gateway().options(in_directory(directory.path())).run(2 * MINUTE).await
    });
    assert_eq!(second.reported("model-superseded"), 1, "{}", second.lines());
    // The candidate was judged against a model that the profile no longer has.
    assert_eq!(second.reported("candidate-better"), 0, "{}", second.lines());
    let axis = &second.samples.last().unwrap().status.axes[0];
    assert_eq!(
        (axis.model.as_deref(), axis.learned.as_ref().unwrap().adopted.as_deref()),
        (Some("difference"), None)
    );
}

#[test]
fn the_gateway_starts_the_learning_program_and_takes_its_candidate() {
    let directory = tempfile::tempdir().unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    write(elsewhere.path(), &offer("learned-2026-01-05-3fa2", 6.9));
    let file = |home: &Path| home.join("bench.products/z.candidate.json").display().to_string();
    std::fs::create_dir(directory.path().join("bench.products")).unwrap();
    let copy = format!("cp {} {}", file(elsewhere.path()), file(directory.path()));
    for (script, is_good) in [("echo 'the logs are empty' >&2; exit 3".to_owned(), false), (copy, true)] {
        let times = LearnTimes { first: Duration::ZERO, every: 60 * MINUTE, recent: Duration::ZERO };
        let (program, arguments) = ("/bin/sh".into(), vec!["-c".into(), script.into()]);
        let learn = Some(LearnCommand { program, arguments, times });
        let done = move |stage: &Stage<'_>| {
            let is_done = || match is_good {
                true => stage.source.status().axes[0].learned.as_ref().unwrap().candidate.is_some(),
                false => stage.source.status().event_counts.contains_key("learning-failed"),
            };
            let tries = 0..200;
            for _ in tries {
                if is_done() {
                    return;
                }
                // The program runs in the time of the computer, not in that of the machine.
                std::thread::sleep(Duration::from_millis(50));
            }
            panic!("the program has not ended after 10 s");
        };
        let trace = block_on(async {
            let mut world = World::new(&learning(""), "").await;
            let trial = world.gateway().options(in_directory(directory.path()));
            let trial = trial.options(move |options| options.learn = learn);
            trial.at(MINUTE, done).run(MINUTE + MINUTE / 2).await
        });
        let failed = trace.events.iter().find(|event| event.kind == "learning-failed");
        assert_eq!(failed.is_some(), !is_good, "{}", trace.lines());
        if let Some(failed) = failed {
            assert!(failed.text.contains("exit status: 3: the logs are empty"), "{}", failed.text);
        }
    }
}

#[test]
fn a_candidate_that_a_person_has_learned_meanwhile_is_taken() {
    let directory = tempfile::tempdir().unwrap();
    let home = directory.path().to_owned();
    let times = LearnTimes { first: 60 * MINUTE, every: 60 * MINUTE, recent: Duration::ZERO };
    let learn = Some(LearnCommand { program: "/bin/false".into(), arguments: Vec::new(), times });
    let learned_by_hand = move |stage: &Stage<'_>| {
        write(&home, &offer("learned-2026-01-05-3fa2", 6.9));
        let tries = 0..200;
        for _ in tries {
            if stage.source.status().axes[0].learned.as_ref().unwrap().candidate.is_some() {
                return;
            }
            // The file is watched in the time of the computer, not in that of the machine.
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("the candidate is not taken after 10 s");
    };
    let trace = block_on(async {
        let mut world = World::new(&learning(""), "").await;
        let trial = world.gateway().options(in_directory(directory.path()));
        let trial = trial.options(move |options| options.learn = learn);
        trial.at(MINUTE, learned_by_hand).run(MINUTE + MINUTE / 2).await
    });
    assert_eq!(trace.reported("candidate-better"), 1, "{}", trace.lines());
}

#[test]
fn a_command_for_an_axis_that_does_not_learn_says_what_to_write() {
    let trace = block_on(async {
        let mut world = World::new(BENCH, "").await;
        let trial = world.gateway().at(MINUTE, |stage| {
            let why = stage.source.command(Command::Adopt, Some("z"), &somebody()).unwrap_err();
            assert!(why.contains("write learn = \"daily\" under [axis.z.probe]"), "{why}");
        });
        let trial = trial.at(MINUTE + 2 * Duration::from_secs(1), |stage| {
            let answer = stage.source.command(Command::AdoptBack, None, &somebody());
            assert!(
                matches!(&answer, Err(why) if why.contains("no axis of the profile learns")),
                "{answer:?}"
            );
        });
        trial.run(2 * MINUTE).await
    });
    assert!(trace.samples[0].status.axes[0].learned.is_none());
}
