//! FE input files: sets with four thousand million nodes, and endless includes.

use std::fmt::Write;

use super::rig::{Home, isotherm, size};

const MESH: &str =
    "*NODE\n1, 0, 0, 0\n2, 100, 0, 0\n3, 0, 100, 0\n4, 0, 0, 100\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n";

#[test]
fn a_set_of_four_thousand_million_nodes_is_refused() {
    let home = Home::new();
    let path = home.write("many.inp", format!("{MESH}*NSET, NSET=ALL, GENERATE\n1, 4000000000, 1\n"));
    isotherm(&["place"], &path)
        .is_refused(1000, &["many.inp:9", "node 5 is not defined, nor are 3999999995 others"]);
    let every_other = format!("{MESH}*ELSET, ELSET=ALL, GENERATE\n1, 4000000000, 2\n");
    let path = home.write("other.inp", every_other);
    isotherm(&["place"], &path)
        .is_refused(1000, &["other.inp:9", "element 3 is not defined, nor are 1999999998 others"]);
}

#[test]
fn a_set_with_a_card_for_each_of_its_members_is_read_in_time() {
    let home = Home::new();
    let (mut nodes, mut elements, mut sets) = (String::new(), String::new(), String::new());
    for element in 0..15_000 {
        let (first, x) = (4 * element + 1, 200 * element);
        writeln!(nodes, "{first}, {x}, 0, 0\n{}, {}, 0, 0", first + 1, x + 100).unwrap();
        writeln!(nodes, "{}, {x}, 100, 0\n{}, {x}, 0, 100", first + 2, first + 3).unwrap();
        writeln!(elements, "{}, {first}, {}, {}, {}", element + 1, first + 1, first + 2, first + 3).unwrap();
        (first..first + 4).for_each(|node| writeln!(sets, "*NSET, NSET=ALL\n{node}").unwrap());
    }
    let text = format!("*NODE\n{nodes}*ELEMENT, TYPE=C3D4, ELSET=BODY\n{elements}{sets}");
    let path = home.write("cards.inp", text);
    isotherm(&["place"], &path).is_refused(size(&path), &["cards.inp:", "the file ends without a step"]);
}

#[test]
fn includes_of_devices_and_without_end_are_refused_at_their_card() {
    let home = Home::new();
    let itself = "*INCLUDE, INPUT=itself.inp\n".repeat(20);
    home.write("twenty.inp", "*INCLUDE, INPUT=again.inp\n".repeat(20));
    home.write("again.inp", "*INCLUDE, INPUT=twenty.inp\n".repeat(20));
    let mut chain = String::new();
    for place in 0..9 {
        chain.clear();
        writeln!(chain, "*INCLUDE, INPUT=deep{}.inp\n*INCLUDE, INPUT=deep{}.inp", place + 1, place + 1)
            .unwrap();
        home.write(&format!("deep{place}.inp"), &chain);
    }
    home.write("deep9.inp", MESH);
    for (name, text, words) in [
        ("zero.inp", "*HEADING\n*INCLUDE, INPUT=/dev/zero\n", ["zero.inp:2", "not a regular file"]),
        ("itself.inp", &itself, ["itself.inp:", "included more than 2 times"]),
        ("fan.inp", "*INCLUDE, INPUT=twenty.inp\n", ["twenty.inp:", "included more than 2 times"]),
        ("deep.inp", "*INCLUDE, INPUT=deep0.inp\n", ["deep7.inp:1", "nested more than 8 levels deep"]),
    ] {
        let path = home.write(name, text);
        isotherm(&["place"], &path).is_refused(100_000, &words);
    }
}

#[test]
fn a_mistake_in_every_line_of_a_mesh_is_told_some_times_and_counted() {
    let home = Home::new();
    let mut text = String::from("*NODE\n");
    (0..300_000).for_each(|node| writeln!(text, "{node}x, 0, 0, 0").unwrap());
    let path = home.write("lines.inp", text);
    isotherm(&["place"], &path).is_refused(size(&path), &["lines.inp:2", "more"]);
    let long = "1,".repeat(10_000_000);
    let path = home.write("line.inp", format!("*NODE\n{long}\n*{}\n", "N".repeat(1_000_000)));
    isotherm(&["place"], &path).is_refused(size(&path), &["line.inp:2", "values, but 4 are required"]);
}
