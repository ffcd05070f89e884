//! Steps from a new profile to a compensated axis. README and the chapter on commissioning have the same steps, which a
//! test compares.

/// Commands after `isotherm init`, each with its visible result. `{}` is the profile, `AXIS` the axis.
const STEPS: [(&str, &str); 8] = [
    ("check {} --online", "every device is \"ok\", and every value is plausible"),
    ("read {}", "warm one sensor by hand: only its value rises"),
    (
        "record {} --out campaign/",
        "a day from a cold start, with the error from a gauge or probe; repeat it on other days",
    ),
    (
        "identify {} campaign/ --axis AXIS --into-profile",
        "the model with its error on other days; yes writes it to the profile",
    ),
    ("run {} --dry-run", "Cz has the opposite sign of the measured error"),
    ("run {}", "the gateway runs, with the axis off; leave it running"),
    ("arm {} --axis AXIS", "in another terminal: the axis is armed"),
    ("sign {} --axis AXIS", "the gauge moves in the plus direction: the sign is right"),
];

/// Returns the list of the next steps for this profile and axis.
pub(super) fn after_init(profile: &str, axis: &str) -> String {
    let lines = STEPS.iter().map(|(command, sees)| {
        let command = format!("isotherm {}", command.replace("{}", profile).replace("AXIS", axis));
        format!("  {command:<68} {sees}\n")
    });
    format!("Next steps, each with its expected result:\n{}", lines.collect::<String>())
}
