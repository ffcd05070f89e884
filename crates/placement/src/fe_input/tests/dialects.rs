//! Forms of FE input that Abaqus, CalculiX, PrePoMax and FreeCAD write. Each must be read as the plain form.

use super::*;

/// Replaces each text of [`FILE`] by another one.
fn changed(changes: &[(&str, &str)]) -> String {
    changes.iter().fold(FILE.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    })
}

#[track_caller]
fn is_read_as(text: &str, wanted: &FeInput) {
    let read = read_text(text).unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    assert_eq!(&read, wanted, "{text}");
}

#[test]
fn names_options_of_other_solvers_and_output_change_nothing() {
    let wanted = read_text(FILE).unwrap();
    for changes in [
        &[("*STEP, INC=100", "*Step, name=Step-1, nlgeom=YES, inc=100")][..],
        &[("*STEP, INC=100", "*STEP, NLGEOM"), ("*FILM", "*FILM, NAME=air"), ("*DFLUX", "*DFLUX, name=a")],
        &[("*STEP, INC=100", "*STEP, NLGEOM=NO, UNSYMM=YES")],
        &[("*NSET, NSET=BASE", "*NSET, internal, unsorted, NSET=BASE")],
        &[("*ELASTIC\n", "*Elastic, NAME=cold\n")],
        &[("STEADY STATE", "steady state, deltmx=0.\n1., 1., 1e-05, 1.,")],
        &[("*HEAT TRANSFER", "*COUPLED TEMPERATURE-DISPLACEMENT")],
        &[("*HEAT TRANSFER", "*Uncoupled Temperature-Displacement")],
        &[("*FILM\n", "*FILM, OP=NEW\n"), ("*BOUNDARY", "*BOUNDARY, OP=NEW")],
        &[("*HEADING", "*Preprint, echo=NO, model=NO, history=NO, contact=NO\n*HEADING")],
        &[("*NODE PRINT", "*Restart, write, frequency=0\n*Output, field, variable=PRESELECT\n*NODE PRINT")],
        &[("*HEADING", "\u{feff}*HEADING")],
        // PrePoMax removes the loads of earlier steps, and FreeCAD writes the parameters of the iteration.
        &[("*FILM\n", "*Cload, op=New\n*Dload, op=New\n*Radiate, op=New\n*Film, op=New\n*FILM\n")],
        &[("*FILM\n", "*FILM\n** Name: air\n"), ("*BOUNDARY", "*Boundary, op=New\n*BOUNDARY")],
        &[("*HEAT", "*CONTROLS, PARAMETERS=TIME INCREMENTATION\n4,8,9,200,10,400,,200,,\n0.25,0.5\n*HEAT")],
    ] {
        is_read_as(&changed(changes), &wanted);
    }
}

#[test]
fn a_coupled_transient_step_is_read_as_heat_transfer() {
    let transient =
        |card: &str| changed(&[("*HEAT TRANSFER, STEADY STATE", format!("{card}\n10, 100").as_str())]);
    let wanted = read_text(&transient("*HEAT TRANSFER")).unwrap();
    assert_eq!(wanted.load.case, Case::Transient { step: 10.0, period: 100.0 });
    is_read_as(&transient("*COUPLED TEMPERATURE-DISPLACEMENT"), &wanted);
    is_read_as(&transient("*HEAT TRANSFER, END=PERIOD, DELTMX=5."), &wanted);
}

#[test]
fn loads_that_grow_during_a_transient_step_are_refused() {
    let step = |amplitude: &str, card: &str| {
        changed(&[
            ("*STEP, INC=100", format!("*STEP, INC=100{amplitude}").as_str()),
            ("*HEAT TRANSFER, STEADY STATE", card),
        ])
    };
    for card in [
        "*HEAT TRANSFER\n10, 100",
        "*COUPLED TEMPERATURE-DISPLACEMENT\n10, 100",
        "*Uncoupled Temperature-Displacement, direct\n10, 100",
    ] {
        let wanted = read_text(&step("", card)).unwrap_or_else(|faults| panic!("{faults}"));
        is_read_as(&step(", AMPLITUDE=STEP", card), &wanted);
        let said = said(&step(", amplitude=Ramp", card));
        assert!(said.contains("*STEP: AMPLITUDE=RAMP: the loads would grow during the step"), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
    // A steady state has the full loads.
    let steady = "*HEAT TRANSFER, STEADY STATE";
    is_read_as(&step(", AMPLITUDE=RAMP", steady), &read_text(FILE).unwrap());
}

#[test]
fn an_omitted_coordinate_is_zero() {
    let wanted = read_text(FILE).unwrap();
    for changes in [
        &[("1, 0, 0, 0", "1")][..],
        &[("1, 0, 0, 0", "1,,,")],
        &[("2, 100, 0, 0", "2, 100")],
        &[("3, 0, 100, 0", "3, , 100,")],
        &[("4, 0, 0, 100", "4,,,100")],
        &[("2, 100, 0, 0", "2, 1.D2, 0")],
    ] {
        is_read_as(&changed(changes), &wanted);
    }
    let said = said(&changed(&[("2, 100, 0, 0", "2, x, 0")]));
    assert!(said.contains("*NODE: `x` is not a number; write the x here"), "{said}");
}

#[test]
fn element_types_of_heat_transfer_have_the_shape_of_the_others() {
    let wanted = read_text(FILE).unwrap();
    for kind in ["DC3D4", "C3D4T", "C3D4H"] {
        is_read_as(&changed(&[("TYPE=C3D4", format!("TYPE={kind}").as_str())]), &wanted);
    }
    let mesh = block(Kind::Tet10);
    let materials = iron(&mesh);
    let load = calm(&mesh, Case::Steady);
    let text =
        [write::mesh(&mesh), write::materials(&mesh, &materials), write::load(&mesh, &load, "")].concat();
    let wanted = read_text(&text).unwrap_or_else(|faults| panic!("{faults}"));
    for kind in ["DC3D10", "C3D10T", "C3D10M", "C3D10MT", "C3D10MH", "C3D10HT"] {
        is_read_as(&text.replace("TYPE=C3D10", &format!("TYPE={kind}")), &wanted);
    }
}

#[test]
fn surface_loads_of_abaqus_are_films_and_fluxes() {
    let surface =
        ("*NSET, NSET=BASE", "*SURFACE, NAME=FOOT, TYPE=ELEMENT, INTERNAL\nBODY, S1\n*NSET, NSET=BASE");
    let plain = changed(&[surface, ("1, F1, 25, 0.008", "FOOT, F, 25, 0.008")]);
    let wanted = read_text(&plain).unwrap_or_else(|faults| panic!("{faults}"));
    is_read_as(&plain.replace("*FILM", "*Sfilm"), &wanted);
    let flux = |card: &str| plain.replace("*DFLUX", &format!("{card}\nFOOT, S, 0.25\n*DFLUX"));
    let wanted = read_text(&flux("*DFLUX")).unwrap_or_else(|faults| panic!("{faults}"));
    is_read_as(&flux("*Dsflux"), &wanted);
}

/// [`FILE`] with these lines of `*BOUNDARY` before its step.
fn with_supports(lines: &str) -> String {
    changed(&[("*STEP, INC=100", format!("*BOUNDARY\n{lines}\n*STEP, INC=100").as_str())])
}

#[test]
fn supports_are_read_in_every_form() {
    let supports = |lines: &str| {
        read_text(&with_supports(lines)).unwrap_or_else(|faults| panic!("{lines}: {faults}")).supports
    };
    for lines in [
        "BASE, 1, 3",
        "BASE, 1, 6",
        "Base, ENCASTRE",
        "BASE, Pinned",
        "BASE,1\nBASE,2\nBASE,3",
        "BASE, 1, 3, 0.",
    ] {
        assert_eq!(supports(lines), [0, 1, 2], "{lines}");
    }
    assert!(supports("BASE, 4, 6").is_empty(), "a solid has no rotations");
    assert_eq!(supports("BODY, 1, 3"), [0, 1, 2, 3], "the nodes of an element set");
    for (lines, wanted) in [
        ("BASE, XSYMM", "*BOUNDARY: XSYMM fixes the nodes in some directions only"),
        ("BASE, FIXED", "*BOUNDARY: `FIXED` is not a whole number above 0"),
        ("BASE, 1, 2", "*BOUNDARY: node 1 is fixed in some directions only"),
        ("BASE, 1, 7", "*BOUNDARY: directions 1 to 7"),
        ("BASE, 3, 1", "*BOUNDARY: directions 3 to 1"),
        ("BASE, 1, 3, 0.1", "the value must be 0"),
    ] {
        let said = said(&with_supports(lines));
        assert!(said.contains(wanted), "{lines}: {said}");
    }
}

#[test]
fn op_new_that_would_remove_supports_is_refused() {
    let text = changed(&[
        ("*STEP, INC=100", "*BOUNDARY\nBASE, 1, 3\n*STEP, INC=100"),
        ("*BOUNDARY\n2, 11", "*BOUNDARY, OP=NEW\n2, 11"),
    ]);
    let said = said(&text);
    assert!(
        said.contains("*BOUNDARY: OP=NEW removes the supports and temperatures of the *BOUNDARY in line"),
        "{said}"
    );
    assert_eq!(said.lines().count(), 1, "{said}");
}

/// The tetrahedron as Abaqus/CAE writes it, in a part with an instance. `instance` is the line of the position, and
/// `nodes` are the coordinates in the part.
fn in_a_part(instance: &str, nodes: &str) -> String {
    format!(
        "*Heading\n** Job name: Job-1\n*Preprint, echo=NO, model=NO, history=NO, contact=NO\n*Part, name=Part-1\n*Node\n\
         {nodes}*Element, type=DC3D4\n1, 1, 2, 3, 4\n*Nset, nset=Set-1, generate\n1, 4, 1\n*Elset, elset=Set-1\n1,\n\
         ** Section: Section-1\n*Solid Section, elset=Set-1, material=Iron\n,\n*End Part\n**\n*Assembly, \
         name=Assembly\n**\n*Instance, name=Part-1-1, part=Part-1\n{instance}*End Instance\n**\n*Nset, nset=Set-1, \
         instance=Part-1-1\n1, 2, 3\n*Nset, nset=BASE, instance=Part-1-1\n1, 2, 3\n*Elset, elset=_Surf-1_S1, internal, \
         instance=Part-1-1\n1,\n*Surface, type=ELEMENT, name=Surf-1\n_Surf-1_S1, S1\n*End Assembly\n*Material, \
         name=Iron\n*Conductivity\n50.,\n*Density\n7.25e-09,\n*Elastic\n110000., 0.26\n*Expansion, zero=20.\n1.1e-05,\n\
         *Specific Heat\n5e+08,\n*Initial Conditions, type=TEMPERATURE\nPart-1-1.Set-1, 20.\n*Boundary\nSet-1, \
         ENCASTRE\n*Step, name=Step-1, nlgeom=NO\n*Heat Transfer, steady state, deltmx=0.\n1., 1., 1e-05, 1.,\n*Sfilm\n\
         Surf-1, F, 25., 0.008\n*Dflux\nPart-1-1.Set-1, BF, 0.001\n*Cflux\nPart-1-1.4, 11, 100.\n*Boundary\nPart-1-1.2, \
         11, 11, 21.5\n*Restart, write, frequency=0\n*Output, field, variable=PRESELECT\n*End Step\n"
    )
}

const NODES: &str = "1, 0., 0., 0.\n2, 100., 0., 0.\n3, 0., 100., 0.\n4, 0., 0., 100.\n";

#[test]
fn a_part_with_one_instance_is_read_as_a_plain_file() {
    let plain = read_text(&changed(&[
        ("*STEP, INC=100", "*BOUNDARY\nBASE, 1, 3\n*STEP, INC=100"),
        ("BODY, S2, 0.5\n", ""),
    ]))
    .unwrap();
    for instance in ["", "0., 0., 0.\n"] {
        let input = read_text(&in_a_part(instance, NODES)).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(input.mesh.xyz, plain.mesh.xyz);
        assert_eq!(input.mesh.elements, plain.mesh.elements);
        assert_eq!(input.materials, plain.materials);
        assert_eq!(input.load, plain.load);
        assert_eq!(input.supports, plain.supports);
        // The set of the assembly has the plain name, and that of the part has the name of the instance too.
        assert_eq!(input.mesh.node_sets["SET-1"], [0, 1, 2]);
        assert_eq!(input.mesh.node_sets["PART-1-1.SET-1"], [0, 1, 2, 3]);
        assert_eq!(input.mesh.node_sets["BASE"], [0, 1, 2]);
    }
    // A name with blanks is in quotation marks.
    let other = in_a_part("", NODES)
        .replace("Part-1-1.Set-1", "\"Part-1-1\".\"My Set\"")
        .replace("set=Set-1", "set=\"My Set\"")
        .replace("Set-1, ENCASTRE", "\"My Set\", ENCASTRE")
        .replace("Part-1-1", "Part 1-1")
        .replace("=Part 1-1", "=\"Part 1-1\"");
    let input = read_text(&other).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.mesh.node_sets["PART 1-1.MY SET"], [0, 1, 2, 3]);
    assert_eq!(input.load, plain.load);
    assert_eq!(input.supports, plain.supports);
    // Names have letters of any language, capital or small.
    let other = in_a_part("", NODES)
        .replace("Part-1-1", "Ständer")
        .replace("Ständer.Set-1, 20.", "STÄNDER.set-1, 20.");
    let input = read_text(&other).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.mesh.node_sets["STÄNDER.SET-1"], [0, 1, 2, 3]);
    // A name of the part that the assembly does not have keeps its form.
    let other = in_a_part("", NODES).replace("*Nset, nset=Set-1, generate", "*Nset, nset=Guide, generate");
    let input = read_text(&other.replace("Part-1-1.Set-1, 20.", "part-1-1.guide, 20."));
    let input = input.unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.mesh.node_sets["GUIDE"], [0, 1, 2, 3]);
}

#[test]
fn an_instance_is_moved_and_then_turned() {
    let plain = read_text(&in_a_part("", NODES)).unwrap();
    // A turn by 90° about the line through (5, 0, 0) along z, after the translation.
    let turned = |[x, y, z]: [f64; 3]| {
        let (x, y, z) = (x + 10.0, y + 20.0, z + 30.0);
        [5.0 - y, x - 5.0, z]
    };
    let input = read_text(&in_a_part("10., 20., 30.\n5., 0., 0., 5., 0., 1., 90.\n", NODES));
    let input = input.unwrap_or_else(|faults| panic!("{faults}"));
    for (placed, xyz) in input.mesh.xyz.iter().zip(&plain.mesh.xyz) {
        let wanted = turned(*xyz);
        assert!((0..3).all(|axis| (placed[axis] - wanted[axis]).abs() < 1e-9), "{placed:?}, not {wanted:?}");
    }
    assert_eq!(input.load, plain.load);
}

#[test]
fn a_mesh_in_the_instance_itself_is_read_too() {
    let text = in_a_part("", NODES);
    let (part, rest) = (text.find("*Node\n").unwrap(), text.find("*End Part").unwrap());
    let own = text[part..rest].to_owned();
    let moved = format!("{}{}", &text[..part], &text[rest..])
        .replace("*End Instance", &format!("{own}*End Instance"));
    assert_eq!(read_text(&moved).unwrap_or_else(|faults| panic!("{faults}")), read_text(&text).unwrap());
}

#[test]
fn what_is_not_supported_in_an_assembly_is_one_error_with_its_remedy() {
    let text = in_a_part("", NODES);
    for (from, to, wanted) in [
        (
            "*End Instance\n",
            "*End Instance\n*Instance, name=Part-1-2, part=Part-1\n*End Instance\n",
            "*INSTANCE: PART-1-2 is a second instance, but one is supported",
        ),
        ("part=Part-1\n", "part=Part-2\n", "*INSTANCE: part PART-2 is not defined (there are PART-1)"),
        ("*Instance, name=Part-1-1, ", "*Instance, ", "*INSTANCE: NAME= is missing"),
        ("*Instance, name=Part-1-1", "*Instance, name=1", "the name 1 does not begin with a letter"),
        ("*End Part", "*End Prat", "*ASSEMBLY: the card is not allowed inside a part"),
        ("*End Assembly\n", "*Node\n9, 0., 0., 0.\n*End Assembly\n", "nodes and elements of the assembly"),
        ("nset=BASE, instance=Part-1-1", "nset=BASE, instance=Part-9", "instance PART-9 is not defined"),
        ("*End Instance", "1., 2., 3., 4.\n*End Instance", "4 values, but 3 are required"),
        (
            "*End Instance",
            "0., 0., 0.\n0., 0., 0., 0., 0., 0., 90.\n*End Instance",
            "the two points of the axis",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let said = said(&text.replacen(from, to, 1));
        assert!(said.contains(wanted), "{to}: wanted: {wanted}\nsaid: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
    let no_instance = &text[..text.find("*Assembly").unwrap()];
    let said = said(no_instance);
    assert!(said.contains("*PART: no instance of a part is in the file"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}
