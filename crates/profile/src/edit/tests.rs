use proptest::prelude::*;

use super::*;

const PROFILE: &str = r##"# a profile
[machine]          # the machine
name = "m"         # its name

[axis.z]           # the axis
limit = 10.0
note = """
[axis.y]
[[axis.z.model]] in a text \"""
"""
list = [
  "[output]",      # no header
  { a = '[x]' },
]

# [[axis.z.model]] as an example

# the output
[output.cnc_z]
axis = "z"
"##;

const BLOCK: &str = "# identified today\n[[axis.z.model]]\nname = \"w\"\nkind = \"linear\"\n\n# spare\n[[axis.z.model]]\nname = \"v\"\n";

#[test]
fn a_first_model_goes_behind_its_axis_and_every_comment_stays() {
    let ModelEdit { text, line, replaced } = put_model(PROFILE, "z", BLOCK).unwrap();
    assert_eq!(replaced, 0);
    for kept in PROFILE.lines().filter(|line| !line.is_empty()) {
        assert!(text.lines().any(|line| line == kept), "{kept} is gone: {text}");
    }
    assert_eq!(text.lines().nth(line - 1), Some("# identified today"));
    let (model, output) =
        (text.find("name = \"w\"").unwrap(), text.find("# the output\n[output.cnc_z]").unwrap());
    assert!(text.find("as an example").unwrap() < model && model < output, "{text}");
}

#[test]
fn another_model_replaces_the_first_one_with_its_comments() {
    let first = put_model(PROFILE, "z", BLOCK).unwrap().text;
    let block = "# identified tomorrow\n[[axis.z.model]]\nname = \"u\"\n";
    let ModelEdit { text, replaced, .. } = put_model(&first, "z", block).unwrap();
    assert_eq!(replaced, 2);
    assert_eq!(text, put_model(PROFILE, "z", block).unwrap().text);
    assert!(!text.contains("today") && !text.contains("# spare") && text.contains("# the output"), "{text}");
}

#[test]
fn a_comment_behind_a_blank_line_stays_when_the_model_above_it_is_replaced() {
    let text = "[axis.z]\nlimit = 1.0\n\n[[axis.z.model]]\nname = \"u\"\n# of the model\n\n# ---- outputs ----\n\n\
                # the output\n[output.cnc_z]\naxis = \"z\"\n";
    let ModelEdit { text: edited, replaced, .. } = put_model(text, "z", BLOCK).unwrap();
    assert_eq!(replaced, 1);
    assert!(
        edited.ends_with(
            "\nname = \"v\"\n\n# ---- outputs ----\n\n# the output\n[output.cnc_z]\naxis = \"z\"\n"
        )
    );
    assert!(!edited.contains("of the model"), "{edited}");
    assert_eq!(put_model(&edited, "z", BLOCK).unwrap().text, edited);
}

#[test]
fn the_last_table_of_a_file_and_other_line_ends_are_edited_too() {
    let text = "[machine]\r\nname = \"m\"\r\n[axis.z]\r\nlimit = 1.0";
    let edited = put_model(text, "z", "[[axis.z.model]]\nname = \"u\"").unwrap().text;
    assert_eq!(edited, format!("{text}\r\n\r\n[[axis.z.model]]\r\nname = \"u\"\r\n"));
}

#[test]
fn what_cannot_be_edited_by_lines_is_refused() {
    for (text, axis, block, why) in [
        ("axis.z.limit = 1.0\n", "z", BLOCK, "no line [axis.z]"),
        ("[axis.y]\nlimit = 1.0\n", "z", BLOCK, "no line [axis.z]"),
        ("[axis.z]\nmodel = [{ name = \"u\" }]\n", "z", BLOCK, "cannot be edited automatically"),
        (PROFILE, "z", "# No model: it would have no term.\n", "has no [[axis.z.model]]"),
        ("[axis.z]\nlimit = = 1\n", "z", BLOCK, "not valid TOML"),
    ] {
        let said = put_model(text, axis, block).unwrap_err();
        assert!(said.contains(why), "{text}: {said}");
    }
}

#[test]
fn the_signal_of_the_machine_start_goes_below_the_header() {
    let edited = put_machine_on(PROFILE, "machine_on").unwrap();
    assert!(
        edited.contains("[machine]          # the machine\non     = \"machine_on\"\nname = \"m\""),
        "{edited}"
    );
    assert!(put_machine_on(&edited, "other").unwrap_err().contains("already has `on`"));
    assert!(put_machine_on("[axis.z]\nlimit = 1.0\n", "on").unwrap_err().contains("no [machine]"));
}

proptest! {
    /// Lines of a profile in any order. An edit either keeps every other line, or is refused.
    #[test]
    fn an_edit_keeps_every_other_line(picked in proptest::collection::vec(0..9_usize, 0..12)) {
        const LINES: [&str; 9] = [
            "[axis.z]", "[axis.y]", "[[axis.z.model]]", "[[axis.y.model]]", "a = \"[axis.z]\"", "# comment", "",
            "b = [\n'[axis.z]',\n]", "c = \"\"\"\n[axis.z]\n\"\"\"",
        ];
        let text = picked.iter().map(|line| format!("{}\n", LINES[*line])).collect::<String>();
        if let Ok(ModelEdit { text: edited, .. }) = put_model(&text, "z", BLOCK) {
            let again = put_model(&edited, "z", BLOCK).unwrap();
            prop_assert_eq!(&again.text, &edited, "the same model again changes nothing");
            let others = |text: &str| {
                let mut table: Table = text.parse().unwrap();
                table["axis"]["z"].as_table_mut().unwrap().remove("model");
                table
            };
            prop_assert_eq!(others(&edited), others(&text));
        }
    }
}
