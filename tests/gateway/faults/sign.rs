//! A sign check without an answer ends three minutes after the offset has arrived.

use std::cell::Cell;
use std::time::Duration;

use isotherm::observe::status::{Answer, Command, DialDirection};

use crate::faults::law;
use crate::faults::rig::{Sample, World, block_on, patient, somebody};

const SECOND: Duration = Duration::from_secs(1);
const MINUTE: Duration = Duration::from_secs(60);

#[test]
fn a_check_waits_three_minutes_for_its_answer_and_then_walks_back() {
    // The gains are small, so that the axis has always arrived when the check begins.
    let text = patient().replace("gain = 2.0", "gain = 0.001").replace("gain = -2.0", "gain = -0.001");
    for answered_after in [Some(170), None] {
        let begun = Cell::new(None);
        let trace = block_on(async {
            let mut world = World::new(&text, "").await;
            let mut trial = world.gateway();
            let begun = &begun;
            for second in 0..20 {
                trial = trial.at(2 * MINUTE + second * SECOND, move |stage| {
                    if begun.get().is_none()
                        && let Ok(Answer::Waits(_)) =
                            stage.source.command(Command::Sign, Some("z"), &somebody())
                    {
                        begun.set(Some(120 + u64::from(second)));
                    }
                });
            }
            let after = Duration::from_secs(answered_after.unwrap_or(400));
            let trial = trial.at(2 * MINUTE + 20 * SECOND + after, move |stage| {
                let signed = Command::Signed(DialDirection::Plus);
                let said = stage.source.command(signed, Some("z"), &somebody());
                assert_eq!(said.is_ok(), answered_after.is_some(), "{said:?}");
            });
            trial.run(10 * MINUTE).await
        });
        law::holds(&trace);
        let begun = begun.get().unwrap_or_else(|| panic!("it was never begun:\n{}", trace.lines()));
        let is_there = |sample: &&Sample| sample.status.axes[0].sign.as_ref().is_some_and(|sign| sign.there);
        let there: Vec<&Sample> = trace.samples.iter().filter(is_there).collect();
        let waited = there[there.len() - 1].at.since(there[0].at).as_secs();
        let ended = trace.events.iter().filter(|event| event.kind == "sign-ended");
        let ended: Vec<&str> = ended.map(|event| event.text.as_str()).collect();
        if answered_after.is_some() {
            assert_eq!((ended.len(), trace.reported("sign-checked")), (0, 1), "{}", trace.lines());
        } else {
            assert!((180..240).contains(&waited), "it waited for {waited} s\n{}", trace.lines());
            assert!(ended.len() == 1 && ended[0].contains("has not reported in time"), "{ended:?}");
        }
        let cz = |second| trace.between(second, second).next().unwrap().status.axes[0].cz_um;
        assert!((cz(begun + 60) - cz(begun) - 5.0).abs() < 0.3, "{}", trace.lines());
        assert!((cz(begun + 330) - cz(begun)).abs() < 0.3, "{}", trace.lines());
    }
}
