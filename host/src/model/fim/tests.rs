//! The fixtures against figures computed elsewhere, and what bad models are answered.

use super::*;
use crate::plan::path::Point;
use screed_fixtures::{PATH_LENGTH, QuarterCircle, quarter_circle};

/// The larger model of this project, written with IfcOpenShell. Its figures are analytic, from its author.
fn large() -> String {
    std::fs::read_to_string(screed_fixtures::data("FIM_fixture_IFC4.ifc")).expect("the fixture is in the repository")
}

fn small() -> String {
    quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() })
}

fn parsed(text: &str) -> FimModel {
    parse("model.ifc", text.as_bytes()).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str) -> ModelError {
    parse("model.ifc", text.as_bytes()).expect_err("must be refused")
}

/// The text with one passage replaced, which must occur.
fn with(text: &str, old: &str, new: &str) -> String {
    assert!(text.contains(old), "the model has no '{old}'");
    text.replacen(old, new, 1)
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance:e}");
}

#[test]
fn the_large_model_has_its_analytic_lengths_and_its_place_in_the_world() {
    let model = parsed(&large());
    assert_eq!(model.schema, "IFC4");
    assert_eq!(model.name, "Printed quarter-circle wall");
    assert_eq!(model.wall_guid, "2jvMlMWvz2CPeqfu3J0tQ9");
    assert_eq!(model.layers.len(), 5);
    for (index, layer) in model.layers.iter().enumerate() {
        assert_eq!((layer.index, layer.segments.len()), (index, 5 - 1 + 24 + 1));
        close(layer.length(), 8.983187172, 1e-9);
        close(layer.segments.last().expect("segments").length(), 0.0896155419, 1e-9);
        close(layer.segments[0].start().z, 0.015 * (index + 1) as f64, 1e-12);
    }
    let (mut low, mut high) = (Point::new(9e9, 9e9, 9e9), Point::new(-9e9, -9e9, -9e9));
    // The published box is without the tail, which IfcOpenShell cannot evaluate and which dips 2.3 mm below it.
    for segment in &model.layers[0].segments[..28] {
        for step in 0..=200 {
            let point = model.site_from_part.transform_point(&segment.eval(f64::from(step) / 200.0).coords);
            (low, high) = (Point::from(low.coords.inf(&point)), Point::from(high.coords.sup(&point)));
        }
    }
    for (found, expected) in low.iter().chain(high.iter()).zip([9.96, 0.66, 0.015, 11.4353, 1.28, 0.015]) {
        close(*found, expected, 1e-4);
    }
}

#[test]
fn the_generated_model_is_the_published_print() {
    let model = parsed(&quarter_circle(&QuarterCircle::default()));
    assert_eq!(model.layers.len(), 10);
    for layer in &model.layers {
        assert_eq!(layer.segments.len(), 1 + 1 + 19 + 2 + 1);
        close(layer.length(), PATH_LENGTH, 1e-9);
        for (before, after) in layer.segments.iter().zip(&layer.segments[1..]) {
            close((after.start() - before.end()).norm(), 0.0, 1e-11);
        }
        let expected = Process {
            layer_time: 70.0,
            acceleration_max: 0.25,
            velocity_max: Some(0.25),
            nozzle_diameter: Some(0.02),
            layer_height: 0.015,
            filament_width: 0.024,
            extrusion_rate: layer.process.extrusion_rate,
        };
        assert_eq!(layer.process, expected);
        close(layer.process.extrusion_rate.expect("declared"), 4.015 / 70.0 * 0.024 * 0.015, 1e-10);
    }
    // Contours and zigzag by hand: π/2·(0.55 + 0.65) + 19·√(0.1² + 4·0.55·0.65·sin²(π/76)).
    let of = |range: std::ops::Range<usize>| model.layers[0].segments[range].iter().map(Segment::length).sum::<f64>();
    close(of(1..2) + of(21..23), 1.884_955_592_153_876, 1e-11);
    close(of(2..21), 19.0 * (0.01 + 4.0 * 0.55 * 0.65 * (std::f64::consts::PI / 76.0).sin().powi(2)).sqrt(), 1e-11);
    // The turned circle, its seam and SameSense .F. lead where the path goes on: (0.65, 0) at the tail's start.
    close((model.layers[9].segments[22].end() - Point::new(0.65, 0.0, 0.15)).norm(), 0.0, 1e-11);
    close((model.layers[0].segments[0].tangent_at(0.0) - nalgebra::Vector3::x()).norm(), 0.0, 1e-12);
}

/// What the message of a refused model must say, and in which line it places the fault: that of the passage given.
fn refuses(text: &str, blamed: &str, expected: &str) {
    let error = refused(text);
    let shown = error.to_string();
    assert!(shown.contains(expected), "expected '{expected}', found '{shown}'");
    let offset = text.find(blamed).unwrap_or_else(|| panic!("the model has no '{blamed}'"));
    let line = text[..offset].lines().count().max(1) + usize::from(text[..offset].ends_with('\n'));
    assert_eq!(error.location().map(|(line, ..)| line), Some(line), "{shown}");
}

#[test]
fn a_missing_unit_is_named_with_its_remedy() {
    let model = small();
    for (unit, name, needed_for) in [
        ("#6,", "LENGTHUNIT", "the geometry"),
        ("#13,", "PLANEANGLEUNIT", "the geometry"),
        ("#9,", "TIMEUNIT", "LayerTime in FIM_LayerProcess"),
        ("#17,", "LINEARVELOCITYUNIT", "MaxVelocity in FIM_ProcessDefaults"),
        ("#20,", "ACCELERATIONUNIT", "MaxAcceleration in FIM_ProcessDefaults"),
        (",#23", "VOLUMETRICFLOWRATEUNIT", "ExtrusionRate in FIM_LayerProcess"),
    ] {
        let assignment = "IFCUNITASSIGNMENT((#6,#7,#8,#13,#9,#17,#20,#23))";
        let text = with(&model, assignment, &with(assignment, unit, ""));
        refuses(&text, "#24=IFCUNITASSIGNMENT", &format!("no {name} is assigned, needed for {needed_for}; add "));
    }
    let text = with(&model, "(#27),#24);", "(#27),$);");
    refuses(&text, "#29=IFCPROJECT", "no LENGTHUNIT is assigned");
    let text = with(&model, "((#6,#7,", "((#6,#14,");
    refuses(&text, "#24=IFCUNITASSIGNMENT", "expected one LENGTHUNIT, found #6 and #14");
    // An area where a length belongs
    let text =
        with(&model, "#6=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.)", "#6=IFCSIUNIT(*,.LENGTHUNIT.,$,.SQUARE_METRE.)");
    refuses(&text, "#6=IFCSIUNIT", "a unit of length ([1, 0, 0, 0, 0, 0, 0]) was expected, found one of [2,");
    let text = with(
        &model,
        "IFCMEASUREWITHUNIT(IFCPLANEANGLEMEASURE(0.017453292519943295),#10)",
        "IFCMEASUREWITHUNIT(IFCPLANEANGLEMEASURE(0.0),#10)",
    );
    refuses(&text, "#13=IFCCONVERSIONBASEDUNIT", "expected a unit of positive, finite size, found 0");
}

#[test]
fn units_are_converted_those_of_properties_too() {
    // Inches: the same figures are 25.4 times the millimetres.
    let inches = with(
        &small(),
        "#6=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);",
        "#6=IFCCONVERSIONBASEDUNIT(#11,.LENGTHUNIT.,'INCH',#900);\n\
        #900=IFCMEASUREWITHUNIT(IFCLENGTHMEASURE(0.0254),#14);",
    );
    let model = parsed(&inches);
    close(model.layers[1].length(), 4015.0 * 0.0254, 1e-7);
    close(model.layers[1].process.filament_width, 24.0 * 0.0254, 1e-15);
    close(model.layers[1].segments[0].start().z, 30.0 * 0.0254, 1e-12);
    close(model.layers[1].process.velocity_max.expect("declared"), 0.25, 0.0);

    // A unit of their own: minutes, mm/s², and litres per minute as a real.
    let own = with(&small(), "'LayerTime',$,IFCTIMEMEASURE(70.),$)", "'LayerTime',$,IFCTIMEMEASURE(2.),#901)");
    let own = own.replace("'LayerTime',$,IFCTIMEMEASURE(70.),$)", "'LayerTime',$,IFCTIMEMEASURE(1.5),#901)");
    let own = with(&own, "IFCACCELERATIONMEASURE(0.25),$)", "IFCACCELERATIONMEASURE(300.),#903)");
    let flow = own.find("IFCVOLUMETRICFLOWRATEMEASURE(").expect("declared");
    let end = flow + own[flow..].find(",$)").expect("no unit");
    let own = format!("{}IFCREAL(0.6),#907{}", &own[..flow], &own[end + 2..]);
    let own = with(
        &own,
        "#25=",
        "#900=IFCMEASUREWITHUNIT(IFCTIMEMEASURE(60.),#9);\n#901=IFCCONVERSIONBASEDUNIT(#11,.TIMEUNIT.,'MINUTE',#900);\n\
        #902=IFCDERIVEDUNITELEMENT(#6,1);\n#903=IFCDERIVEDUNIT((#902,#19),.ACCELERATIONUNIT.,$);\n\
        #904=IFCSIUNIT(*,.VOLUMEUNIT.,.DECI.,.CUBIC_METRE.);\n#905=IFCDERIVEDUNITELEMENT(#904,1);\n#906=IFCDERIVEDUNITELEMENT(#901,-1);\n\
        #907=IFCDERIVEDUNIT((#905,#906),.VOLUMETRICFLOWRATEUNIT.,$);\n#25=",
    );
    let process = &parsed(&own).layers[0].process;
    close(process.layer_time, 90.0, 1e-12);
    close(process.acceleration_max, 0.3, 1e-15);
    close(process.extrusion_rate.expect("declared"), 0.6e-3 / 60.0, 1e-18);

    let wrong = with(&small(), "IFCACCELERATIONMEASURE(0.25),$)", "IFCACCELERATIONMEASURE(0.25),#17)");
    refuses(
        &wrong,
        "#17=IFCDERIVEDUNIT",
        "a unit of acceleration ([1, 0, -2, 0, 0, 0, 0]) was expected, found one of [1, 0, -1,",
    );
    let wrong = with(&small(), "IFCACCELERATIONMEASURE(0.25),$)", "IFCREAL(0.25),$)");
    refuses(&wrong, "#59=IFCPROPERTYSINGLEVALUE", "attribute Unit: expected a unit of acceleration, or the value as");
    let wrong = with(&small(), "IFCACCELERATIONMEASURE(0.25),$)", "IFCLINEARVELOCITYMEASURE(0.25),$)");
    refuses(&wrong, "#59=", "expected a acceleration (IFCACCELERATIONMEASURE), found IFCLINEARVELOCITYMEASURE(0.25)");
}

#[test]
fn process_parameters_are_complete_and_possible_or_refused() {
    let model = small();
    for (property, number) in [("MaxAcceleration", 59), ("LayerHeight", 62), ("FilamentWidth", 63)] {
        let text = with(&model, &format!("#{number},"), "");
        let expected = format!("'Layer 000': no {property}; add it to property set FIM_LayerProcess of the layer, or");
        refuses(&text, "IFCBUILDINGELEMENTPART", &expected);
    }
    let text = model.replace("'LayerTime'", "'TimeOfLayer'");
    refuses(&text, "IFCBUILDINGELEMENTPART", "'Layer 000': no LayerTime");
    let text = with(&model, "'MaxAcceleration'", "'MaxAccelleration'");
    refuses(&text, "#59=", "property MaxAccelleration in FIM_ProcessDefaults: expected the name MaxAcceleration");
    let text = with(&model, "'NozzleDiameter'", "'LayerHeight'");
    refuses(&text, "#62=", "property LayerHeight in FIM_ProcessDefaults: expected to occur once");
    for bad in ["-15.", "0.", "$", "IFCLABEL('15')"] {
        let value =
            if bad.contains('I') || bad == "$" { bad.to_owned() } else { format!("IFCPOSITIVELENGTHMEASURE({bad})") };
        let text = with(&model, "'LayerHeight',$,IFCPOSITIVELENGTHMEASURE(15.)", &format!("'LayerHeight',$,{value}"));
        refuses(&text, "#62=", "#62 IFCPROPERTYSINGLEVALUE: ");
    }
    let text = with(&model, "IFCLABEL('1.0')", "IFCLABEL('2.0')");
    refuses(&text, "#64=", "property FimSchemaVersion in FIM_ProcessDefaults: expected version 1, found '2.0'");
    // The layer's own value comes before the wall's.
    let text = with(&model, "('LayerIndex',$,IFCINTEGER(0),$)", "('FilamentWidth',$,IFCLENGTHMEASURE(30.),$)");
    let text = with(&text, "('LayerIndex',$,IFCINTEGER(1),$)", "('Colour',$,IFCLABEL('grey'),$)");
    let layers = parsed(&text).layers;
    assert_eq!((layers[0].process.filament_width, layers[1].process.filament_width), (0.03, 0.024));
}

#[test]
fn the_order_of_layers_is_certain_or_refused() {
    let index = |layer: usize| format!("('LayerIndex',$,IFCINTEGER({layer}),$)");
    let none = "('Colour',$,IFCLABEL('grey'),$)";
    let model = small();
    let names = |text: &str| parsed(text).layers.into_iter().map(|layer| layer.name).collect::<Vec<_>>();
    assert_eq!(names(&model), ["Layer 000", "Layer 001"]);
    // Without an index the heights decide, whatever the order in the file.
    let unnumbered = with(&with(&model, &index(0), none), &index(1), none);
    let swapped = with(&with(&unnumbered, "((0.,0.,15.))", "((0.,0.,31.))"), "((0.,0.,30.))", "((0.,0.,16.))");
    assert_eq!(names(&swapped), ["Layer 001", "Layer 000"]);
    let numbered = with(&with(&model, &index(0), &index(7)), &index(1), &index(5));
    refuses(
        &numbered,
        "IFCBUILDINGELEMENTPART",
        "its LayerIndex is above that of 'Layer 001', but its path starts 15.000 mm lower",
    );
    let one = with(&model, &index(1), none);
    refuses(&one, "IFCBUILDINGELEMENTPART", "other layers have a LayerIndex, 'Layer 001' has none");
    let twice = with(&model, &index(1), &index(0));
    refuses(&twice, "'Layer 001'", "LayerIndex 0 is that of 'Layer 000', too");
    let same_height = with(&unnumbered, "((0.,0.,30.))", "((0.,0.,15.))");
    refuses(&same_height, "'Layer 001'", "starts as high as 'Layer 000', and neither has a LayerIndex");
}

#[test]
fn a_declared_length_that_is_not_the_curves_is_refused() {
    let text = with(&small(), "'PathLength',$,$,4015.,$)", "'PathLength',$,$,4019.,$)");
    parsed(&text);
    let text = with(&small(), "'PathLength',$,$,4015.,$)", "'PathLength',$,$,4020.,$)");
    let expected = "PathLength declares 4020.000 mm, but the curve #125 of layer 'Layer 000' is 4015.000 mm long";
    refuses(&text, "'PathLength',$,$,4020.", expected);
}

#[test]
fn geometry_that_cannot_be_printed_is_refused_by_name_and_line() {
    let gap = with(&small(), "IFCPARAMETERVALUE(45.)),(IFC", "IFCPARAMETERVALUE(46.)),(IFC");
    refuses(&gap, "#112=IFCTRIMMEDCURVE", "starts 11.344");
    let circle = with(&small(), "#76=IFCCIRCLE(#75,650.)", "#76=IFCELLIPSE(#75,650.,650.)");
    refuses(
        &circle,
        "#76=",
        "#76 IFCELLIPSE: unsupported segment in 'Layer 000'; write it as IfcTrimmedCurve of IfcCircle",
    );
    let placement = small().replace("=IFCLOCALPLACEMENT(#53,", "=IFCGRIDPLACEMENT(#53,");
    refuses(&placement, "IFCGRIDPLACEMENT", "IFCGRIDPLACEMENT: unsupported placement; write it as IfcLocalPlacement");
    let circular = with(&small(), "#34=IFCLOCALPLACEMENT($,", "#34=IFCLOCALPLACEMENT(#53,");
    assert!(refused(&circular).to_string().contains("nested deeper than 64"));
    let far =
        with(&small(), "((0.,0.,15.))", "((1.E308,0.,1.E308))").replace("((1500.,800.,0.))", "((1.E308,1.E308,0.))");
    let far = with(&far, ".MILLI.,.METRE.", ".KILO.,.METRE.");
    refuses(&far, "IFCBUILDINGELEMENTPART", "the path lies beyond all numbers");
    let dangling = with(&small(), "#84=IFCVECTOR(#83,2.)", "#84=IFCVECTOR(#83000,2.)");
    refuses(&dangling, "#84=", "#84 IFCVECTOR: refers to #83000, which is not in the file");
    let flat = with(&small(), "#79=IFCDIRECTION((0.866025403784,0.5,0.))", "#79=IFCDIRECTION((0.,0.,1.))");
    refuses(
        &flat,
        "#80=IFCAXIS2PLACEMENT3D",
        "attribute RefDirection: expected a direction across Axis, found one along it",
    );
}

#[test]
fn the_published_shape_is_read_too() {
    // Project → component → layers without marks, other representation names, placements of layers given in the world.
    let plain = small().replace("'FIM_LAYER'", "$").replace("'FIM',", "$,").replace("FIM_LayerProcess", "FIM_Other");
    let plain = with(&plain, "FIM_ProcessDefaults", "Pset_None");
    let found = refused(&plain).to_string();
    assert!(found.contains("'Layer 000': no LayerTime"), "{found}");
    for identifier in ["Toolpath", "Slice"] {
        let named =
            small().replace("'FIM_LAYER'", "$").replace("'Axis','Curve3D'", &format!("'{identifier}','Curve3D'"));
        assert_eq!(parsed(&named).layers.len(), 2);
    }
    let project_above = with(
        &small(),
        "IFCRELAGGREGATES('",
        "IFCRELAGGREGATES('0000000000000000000000',$,$,$,#29,(#54));\n#899=IFCRELAGGREGATES('",
    );
    assert_eq!(parsed(&project_above).layers.len(), 2);
    let foreign = with(&small(), "'Axis','Curve3D'", "'Body','Curve3D'");
    refuses(
        &foreign,
        "IFCBUILDINGELEMENTPART",
        "expected a representation Axis, Toolpath or Slice with the layer's path",
    );
}

#[test]
fn no_wall_and_two_walls_are_refused() {
    let none = quarter_circle(&QuarterCircle { layers: 0, ..QuarterCircle::default() });
    let error = refused(&none);
    assert!(error.to_string().starts_with("model.ifc: a FIM wall"), "{error}");
    assert!(error.location().is_none());
    let layer = small()
        .lines()
        .find(|line| line.contains("'Layer 001'"))
        .and_then(|line| line.split('=').next().map(str::to_owned));
    let second = format!(
        "ENDSEC;\nDATA;\n#900=IFCWALL('',$,'Other',$,'FIM',$,$,$,$);\n#901=IFCRELAGGREGATES('',$,$,$,#900,({}));\nENDSEC;\nEND",
        layer.expect("a layer")
    );
    let error = refused(&with(&small(), "ENDSEC;\nEND", &second));
    let expected = "there are #54 'Printed quarter-circle wall', #900 'Other'";
    assert!(error.to_string().contains(expected), "{error}");
}

#[test]
fn layers_placed_in_the_world_lie_where_the_chain_through_the_wall_puts_them() {
    let through_wall = parsed(&small());
    // The same place by a chain of its own: all four placements again under other numbers.
    let mut text = small();
    let wall_chain = [(34, 934), (40, 940), (44, 944), (53, 953)];
    let mut copies = String::new();
    for (index, (old, new)) in wall_chain.iter().enumerate() {
        let line = text.lines().find(|line| line.starts_with(&format!("#{old}="))).expect("a placement").to_owned();
        let outer = if index == 0 { "$".to_owned() } else { format!("#{}", wall_chain[index - 1].1) };
        let axes = line.split_once(',').expect("two attributes").1.to_owned();
        copies += &format!("#{new}=IFCLOCALPLACEMENT({outer},{axes}\n");
    }
    text = text.replace("=IFCLOCALPLACEMENT(#53,", "=IFCLOCALPLACEMENT(#953,");
    text = with(&text, "ENDSEC;\nEND", &format!("{copies}ENDSEC;\nEND"));
    let by_world = parsed(&text);
    for (a, b) in through_wall.layers.iter().zip(&by_world.layers) {
        for (a, b) in a.segments.iter().zip(&b.segments) {
            for t in [0.0, 0.5, 1.0] {
                assert!((a.eval(t) - b.eval(t)).norm() < 1e-14 * 100.0, "{:?} {:?}", a.eval(t), b.eval(t));
            }
        }
    }
    // Turns of 10°, 25° and 30°; the origin by hand.
    let turn = |degrees: f64, x: f64, y: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        (c * x - s * y, s * x + c * y)
    };
    let (x, y) = turn(25.0, 1.5, 0.8);
    let (x, y) = turn(10.0, 8.0 + x, -3.0 + y);
    let origin = nalgebra::Vector3::new(12.0 + x, 5.0 + y, 0.35);
    assert!((through_wall.site_from_part.translation - origin).norm() < 1e-10);
    let (c, s) = (65_f64.to_radians().cos(), 65_f64.to_radians().sin());
    assert!((through_wall.site_from_part.rotation.column(0) - nalgebra::Vector3::new(c, s, 0.0)).norm() < 1e-11);
}

/// In front of a UR10e, its tool pointing down, every point of every layer is reached on one branch.
#[test]
fn the_generated_wall_is_within_reach_of_a_ur10e() {
    use screed_kernel::arms::ur::UR10E;
    use screed_kernel::ik::ur::nearest;
    use screed_kernel::units::JointPos;
    use std::f64::consts::PI;
    let base_from_part = Pose::from_roll_pitch_yaw(nalgebra::Vector3::new(0.15, 0.0, -0.1), 0.0, 0.0, -PI / 4.0);
    let flange_from_tcp = Pose::from_translation(0.0, 0.0, 0.2);
    let down = Pose::from_roll_pitch_yaw(nalgebra::Vector3::zeros(), PI, 0.0, 0.0).rotation;
    let mut joints = JointPos([15.0, -90.0, -90.0, -90.0, 90.0, -30.0].map(f64::to_radians));
    for layer in parsed(&quarter_circle(&QuarterCircle::default())).layers {
        let mut first = true;
        for point in layer.segments.iter().flat_map(|segment| (0..=50).map(|step| segment.eval(f64::from(step) / 50.0)))
        {
            let base_from_tcp = Pose { rotation: down, translation: base_from_part.transform_point(&point.coords) };
            let next = nearest(&UR10E, &(base_from_tcp * flange_from_tcp.inverse()), &joints)
                .unwrap_or_else(|error| panic!("{point}: {error:?}"))
                .joints;
            let step = next.0.iter().zip(&joints.0).fold(0.0, |far: f64, (a, b)| far.max((a - b).abs()));
            // From point to point at most 42 mm; a change of branch would be half a turn somewhere.
            assert!(first || step < 0.3, "{point}: {step} rad");
            (joints, first) = (next, false);
        }
    }
}
