//! Results of `place`, and the files that it writes.

use serde_json::Value;

use crate::place::calculix::{AGREED, answers, relative};
use crate::place::column::{Warming, changed, guide, place, place_by, write_inputs};
use crate::place::process::{file, isotherm};

const CASES: [Warming; 3] = [Warming::Air, Warming::Spindle, Warming::Motor];
const FILES: [&str; 3] = ["air.inp", "spindle.inp", "motor.inp"];

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn one_placement_for_all_cases_beats_block_centres_and_every_placement_by_one_case() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES);
    let answer = place(home.path(), &[&FILES[..], &["--json"]].concat());
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let found: Value = serde_json::from_str(&answer.out).unwrap();
    assert_eq!(found["P"].as_array().unwrap().len(), 3 * guide());
    assert!(found["P"].as_array().unwrap().iter().all(|row| row.as_array().unwrap().len() == 8));
    assert_eq!(found["guide_nodes"].as_array().unwrap().len(), guide());
    for name in ["air", "spindle", "motor"] {
        let case = &found["cases"][name];
        assert_eq!(case["delta1_mm"].as_array().unwrap().len(), 3 * guide());
        let floor = number(&case["floor"]["rms_um"]);
        for method in ["patent", "bounded", "multi-case"] {
            let placed = &case[method];
            assert!(number(&placed["rms_um"]) >= floor - 1e-9, "{name}, {method}: below the floor");
            assert!(number(&placed["max_um"]) >= number(&placed["rms_um"]));
            let sensors = placed["sensors"].as_array().unwrap();
            let blocks: Vec<&str> = sensors.iter().map(|sensor| sensor["block"].as_str().unwrap()).collect();
            assert_eq!(blocks, ["BLK1", "BLK2", "BLK3", "BLK4", "BLK5", "BLK6", "BLK7", "BLK8"]);
            assert!(sensors.iter().all(|sensor| sensor["node"].is_u64() && sensor["xyz"].is_array()));
        }
    }
    // Over all cases together, no placement for a single case is nearly as good as the common placement.
    let together = |row: &Value| {
        let each = row["rms_um"].as_array().unwrap();
        each.iter().map(|rms| number(rms).powi(2)).sum::<f64>().sqrt()
    };
    let rows = found["cross_case"].as_array().unwrap();
    let all = rows.iter().find(|row| row["method"] == "multi-case").map(together).unwrap();
    for row in rows.iter().filter(|row| row["method"] != "multi-case") {
        assert!(all < together(row), "{row}: {all}");
    }
    let centres =
        ["air", "spindle", "motor"].map(|name| number(&found["cases"][name]["naive_centroid"]["rms_um"]));
    assert!(all < 0.5 * centres.iter().map(|rms| rms.powi(2)).sum::<f64>().sqrt(), "{all}: {centres:?}");
    // More sensors, by the best cut, reduce the lower bound of the error.
    let by_number = found["by_number"].as_array().unwrap();
    let numbers: Vec<u64> = by_number.iter().map(|entry| entry["sensors"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (1..=12).collect::<Vec<u64>>());
    assert!(number(&by_number[11]["floor_um"]) < number(&by_number[7]["floor_um"]));
}

/// The patent uses one load case. With the same case, this method has at most the same residual.
#[test]
fn placed_by_one_case_alone_it_is_at_least_as_good_as_the_patent_on_every_case() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES);
    for (name, input) in ["air", "spindle", "motor"].into_iter().zip(FILES) {
        let answer = place(home.path(), &[input, "--json"]);
        let found: Value = serde_json::from_str(&answer.out).unwrap();
        let case = &found["cases"][name];
        let left = number(&case["multi-case"]["rms_um"]);
        for method in ["patent", "bounded"] {
            let placed = number(&case[method]["rms_um"]);
            assert!(left <= placed + 1e-9, "{name}: {left}, {method} {placed}");
        }
    }
}

#[test]
fn rows_come_in_the_order_in_which_the_file_names_the_guideway() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[..1]);
    let input = std::fs::read_to_string(home.path().join("air.inp")).unwrap();
    let structure = std::fs::read_to_string(home.path().join("structure.inc")).unwrap();
    file(home.path(), "forwards.inc", &structure);
    file(home.path(), "forwards.inp", &input.replace("structure.inc", "forwards.inc"));
    let found = |inputs: &[&str]| -> Value {
        let answer = place(home.path(), &[inputs, &["--json"]].concat());
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        serde_json::from_str(&answer.out).unwrap()
    };
    let nodes = |found: &Value| found["guide_nodes"].as_array().unwrap().clone();
    let before = found(&["air.inp"]);
    let backwards: Vec<Value> = nodes(&before).into_iter().rev().collect();
    changed(home.path(), |text| {
        let (head, rest) = text.split_once("*NSET, NSET=GUIDE\n").unwrap();
        let (_, tail) = rest.split_once('*').unwrap();
        let lines: String = backwards.iter().map(|node| format!("{node},\n")).collect();
        format!("{head}*NSET, NSET=GUIDE\n{lines}*{tail}")
    });
    // If the files name the nodes in different orders, the order of the first file is used. It is the same structure.
    let after = found(&["air.inp", "forwards.inp"]);
    assert_eq!(nodes(&after), backwards);
    // Rows 3·guide + component: those of the first node are now those of the last one.
    let last = 3 * (guide() - 1);
    for component in 0..3 {
        let row = |found: &Value, at: usize| found["P"][at].as_array().unwrap().clone();
        for (one, other) in row(&before, component).iter().zip(row(&after, last + component)) {
            assert!((number(one) - number(&other)).abs() < 1e-12, "{one} {other}");
        }
    }
}

/// Writes the load case `air` under this name, with these lines of `*BOUNDARY`.
fn write_supported(home: &std::path::Path, name: &str, lines: &str) {
    let input = std::fs::read_to_string(home.join("air.inp")).unwrap();
    let (include, rest) = input.split_once('\n').unwrap();
    file(home, &format!("{name}.inp"), &format!("{include}\n*BOUNDARY\n{lines}\n{rest}"));
}

#[test]
fn the_supports_of_the_files_hold_also_if_a_set_is_named_base() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[..1]);
    // Ten nodes at the top are held, instead of the foot.
    let mesh = std::fs::read_to_string(home.path().join("structure.inc")).unwrap();
    let (_, top) = mesh.split_once("*NSET, NSET=BLK4\n").unwrap();
    let nodes = top.lines().next().unwrap().split(',').map(str::trim).filter(|node| !node.is_empty());
    let lines: Vec<String> = nodes.map(|node| format!("{node}, 1, 3")).collect();
    write_supported(home.path(), "held", &lines.join("\n"));
    let found = |arguments: &[&str]| -> (String, Value) {
        let answer = place(home.path(), &[arguments, &["--json"]].concat());
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        let found = serde_json::from_str(&answer.out).unwrap();
        (answer.out, found)
    };
    let largest = |found: &Value, case: &str| number(&found["cases"][case]["largest_um"]);
    let remarks = |found: &Value| found["remarks"].to_string();
    let (_, on_base) = found(&["air.inp"]);
    assert!(
        remarks(&on_base).contains("of the node set BASE are fixed, because no FE input file has supports")
    );
    let (out, held) = found(&["held.inp"]);
    assert!(remarks(&held).contains("nodes of *BOUNDARY in held are fixed"), "{}", remarks(&held));
    let (one, other) = (largest(&on_base, "air"), largest(&held, "held"));
    assert!((one - other).abs() > 0.05 * one, "other supports, another displacement: {one}, {other}");
    // The supports of the second file hold for the first one too, which has none.
    let (_, both) = found(&["air.inp", "held.inp"]);
    for case in ["air", "held"] {
        assert!((largest(&both, case) - other).abs() < 1e-9 * other, "{case}");
    }
    // An option replaces them, and the output says so.
    let (_, by_option) = found(&["held.inp", "--fixed", "base"]);
    assert!((largest(&by_option, "held") - one).abs() < 1e-9 * one);
    assert!(remarks(&by_option).contains("--fixed replaces the supports of *BOUNDARY in held"));
    // The name of the set changes nothing.
    changed(home.path(), |text| text.replace("NSET=BASE", "NSET=FOOT"));
    assert_eq!(found(&["held.inp"]).0, out);
}

#[test]
fn the_same_files_give_the_same_sensors() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[..2]);
    let shown = || place(home.path(), &["air.inp", "spindle.inp"]).out;
    let first = shown();
    assert!(first.contains("sensors by multi-case"), "{first}");
    assert_eq!(first, shown());
}

#[test]
fn every_case_has_its_whole_name_over_its_column() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &[Warming::Air, Warming::SpindleHour]);
    let shown = place(home.path(), &["air.inp", "spindle_hour.inp"]).out;
    let heads: Vec<&str> = shown.lines().find(|line| line.contains("method ")).unwrap().split(' ').collect();
    assert!(heads.contains(&"air") && heads.contains(&"spindle_hour"), "{shown}");
}

#[test]
fn planes_give_blocks_where_the_file_has_none_and_divide_one_alone() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[1..2]);
    let cut = ["spindle.inp", "--blocks", "NONE", "--cut", "y=750", "--cut", "x=0:BLKb", "--json"];
    let answer = place(home.path(), &cut);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let found: Value = serde_json::from_str(&answer.out).unwrap();
    assert_eq!(found["blocks"], serde_json::json!(["BLKa", "BLKba", "BLKbb"]));
}

#[test]
fn its_model_is_taken_by_a_profile_and_its_report_is_one_file() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[..2]);
    let write = ["air.inp", "spindle.inp", "--write", "column.toml", "--report", "sensors.html"];
    let answer = place(home.path(), &write);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let signal = |name: String, unit: &str| {
        format!(
            "[signal.{name}]\ndevice = \"module\"\nregister = \"input:{}\"\ntype = \"i16\"\nscale = 0.1\nunit = \
             \"{unit}\"\nmax_age = \"5s\"\n",
            name.len() * 100 + usize::from(name.as_bytes()[name.len() - 1])
        )
    };
    let blocks: String = (1..=8).map(|block| signal(format!("blk{block}"), "degC")).collect();
    let profile = format!(
        "[machine]\nname = \"column\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1\"\ntimeout = \"300ms\"\n\
         [device.module]\nbus = \"cell\"\nunit = 1\nevery = \"1s\"\n{blocks}{}[axis.z]\nlimit = 200.0\nstep = 1.0\nrate = \
         0.5\nevery = \"10s\"\non_fault = {{ action = \"hold\" }}\n{}[output.cnc]\naxis = \"z\"\ndevice = \
         \"module\"\nwrites = \"offset\"\nregister = \"holding:104\"\ntype = \"i32\"\nword_order = \"msw-first\"\nscale = \
         0.1\nverify = \"read-back\"\n",
        signal("scale_y".to_owned(), "mm"),
        std::fs::read_to_string(home.path().join("column.toml")).unwrap()
    );
    file(home.path(), "machine.toml", &profile);
    let checked =
        isotherm(home.path()).current_dir(home.path()).args(["check", "machine.toml"]).output().unwrap();
    let said = String::from_utf8_lossy(&checked.stderr);
    assert_eq!(checked.status.code(), Some(0), "{said}");
    assert!(String::from_utf8_lossy(&checked.stdout).contains("column.matrix.json"));
    let page = std::fs::read_to_string(home.path().join("sensors.html")).unwrap();
    for wanted in ["<svg", "Residual error of each case", "Error by number of sensors", "BLK8"] {
        assert!(page.contains(wanted), "`{wanted}` is not in the report");
    }
    for outside in ["<script", "src=", "href=", "http"] {
        assert!(!page.contains(outside), "`{outside}` is in the report");
    }
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
}

/// The steps of `docs/placement.md`, from no files to the models of a profile and a simulated plant.
#[test]
fn the_example_leads_to_models_of_two_axes_with_a_rider_and_to_the_modes_of_its_plant() {
    let home = tempfile::tempdir().unwrap();
    let made = place(home.path(), &["--example", "column"]);
    assert_eq!(made.code, Some(0), "{}", made.said);
    assert!(made.out.contains("isotherm place column/head_hour.inp"), "{}", made.out);
    assert!(made.out.contains("--blocks COLUMN_ --candidates REACHED"), "{}", made.out);
    let cases =
        ["column/head_low.inp", "column/layers.inp", "--blocks", "COLUMN_", "--candidates", "REACHED"];
    let asked = ["--component", "z,y", "--rider", "Head:z=-4.95/y=0.5", "--plant", "column/plant.inp"];
    let out = ["--modes", "modes.json", "--write", "model.toml", "--json"];
    let answer = place(home.path(), &[&cases[..], &asked, &out].concat());
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let found: Value = serde_json::from_str(&answer.out).unwrap();
    assert_eq!(found["component"], "y, z");
    let case = &found["cases"]["head_low"];
    assert!(number(&case["multi-case"]["rms_um"]) < number(&case["naive_centroid"]["rms_um"]));
    let read = |name: &str| std::fs::read_to_string(home.path().join(name)).unwrap();
    let model = read("model.toml");
    for wanted in
        ["[[axis.y.model]]", "[[axis.z.model]]", "component = \"y\"", "\"column_front_4\", \"head\"]"]
    {
        assert!(model.contains(wanted), "{model}");
    }
    let matrix: Value = serde_json::from_str(&read("model.matrix.json")).unwrap();
    let rows = matrix["P"].as_array().unwrap();
    assert_eq!((rows.len(), rows[0].as_array().unwrap().len()), (3 * 11, 9));
    let rider: Vec<f64> = rows[..3].iter().map(|row| number(&row[8])).collect();
    assert_eq!(rider, [0.0, 0.0005, -0.00495]);
    let modes: Value = serde_json::from_str(&read("modes.json")).unwrap();
    let names = |group: &str| modes[group].as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(names("sinks"), ["air_high", "air_low", "covers", "foot", "inside"]);
    assert_eq!(names("ports").len(), 7);
    assert_eq!(names("points")[..2], ["column_back_1", "column_back_1_centre"]);
    assert_eq!(modes["guide_mm"], matrix["guide_mm"]);
    assert!(read("modes.json").len() < 80_000);
}

#[test]
fn a_method_of_one_case_says_by_which_it_placed() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[..2]);
    let by = |arguments: &[&str]| place(home.path(), &[&["air.inp", "spindle.inp"], arguments].concat()).out;
    let shown = by(&["--method", "patent"]);
    assert!(shown.contains("sensors by patent, placed for spindle"), "the one that moves it most: {shown}");
    let shown = by(&["--method", "bounded", "--case", "air"]);
    assert!(shown.contains("sensors by bounded, placed for air"), "{shown}");
}

#[test]
fn calculix_as_the_engine_gives_the_same_p_and_the_same_displacements() {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &CASES[1..2]);
    // P, then the displacements of the case.
    let by = |engine: &str, program: &str| -> Vec<f64> {
        let found = place_by(program, home.path(), &["spindle.inp", "--json", "--engine", engine]);
        assert_eq!(found.code, Some(0), "{}", found.said);
        let found: Value = serde_json::from_str(&found.out).unwrap();
        if engine == "ccx" {
            assert_eq!(
                found["by_number"],
                serde_json::json!([]),
                "only the own engine knows other divisions"
            );
        }
        let rows = found["P"].as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap());
        rows.chain(found["cases"]["spindle"]["delta1_mm"].as_array().unwrap()).map(number).collect()
    };
    let apart = |own: &[f64], other: &[f64]| {
        let moved = own.len() - 3 * guide();
        let (p, displacements) =
            (relative(&own[..moved], &other[..moved]), relative(&own[moved..], &other[moved..]));
        p.max(displacements)
    };
    let own = by("own", "");
    let question = "P and displacements by place --engine ccx";
    for (referee, theirs) in answers(question, |referee| by("ccx", referee.program)) {
        let apart = apart(&own, &theirs);
        assert!(apart < AGREED, "{referee}: {apart:e}");
    }
}
