//! Each kind of curve against geometry worked out by hand.

use super::*;
use crate::model::p21::File;
use core::f64::consts::PI;

/// In millimetres and degrees; the curve is #100.
const DEGREES: &str = "#2=IFCUNITASSIGNMENT((#3,#6));#3=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);\
    #4=IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.);#5=IFCMEASUREWITHUNIT(IFCPLANEANGLEMEASURE(0.017453292519943295),#4);\
    #6=IFCCONVERSIONBASEDUNIT($,.PLANEANGLEUNIT.,'DEGREE',#5);";
/// In metres and radians.
const RADIANS: &str = "#2=IFCUNITASSIGNMENT((#3,#4));#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\
    #4=IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.);";
/// A circle of radius 2 around (1, 0), its angles counted from y.
const CIRCLE: &str = "#10=IFCCARTESIANPOINT((1.,0.));#11=IFCDIRECTION((0.,1.));#12=IFCAXIS2PLACEMENT2D(#10,#11);\
    #20=IFCCIRCLE(#12,2.);";
/// A line from (1, 0) along y, 2 a parameter.
const LINE: &str =
    "#10=IFCCARTESIANPOINT((1.,0.));#11=IFCDIRECTION((0.,5.));#13=IFCVECTOR(#11,2.);#20=IFCLINE(#10,#13);";

fn read(units: &str, entities: &str, precision: Option<f64>) -> Result<Vec<Piece>, ModelError> {
    let text = format!(
        "ISO-10303-21;HEADER;ENDSEC;DATA;#1=IFCPROJECT('',$,$,$,$,$,$,$,#2);{units}\n{entities}\nENDSEC;END-ISO-10303-21;"
    );
    let file = File::parse("curve.ifc", text.as_bytes())?;
    let units = Units::read(&file)?;
    let curve = file.record_of(file.get(100).expect("#100"))?;
    Curves::new(&units, precision, "Layer 1").read(&curve)
}

fn pieces(units: &str, entities: &str) -> Vec<Piece> {
    read(units, entities, None).unwrap_or_else(|error| panic!("{error}"))
}

fn message(units: &str, entities: &str) -> String {
    read(units, entities, None).map(|_| ()).expect_err("must be refused").to_string()
}

/// Start, middle and end of a curve of one piece, and its length.
fn check(units: &str, entities: &str, points: [[f64; 2]; 3], length: f64) {
    let pieces = pieces(units, entities);
    assert_eq!(pieces.len(), 1, "{entities}");
    let segment = &pieces[0].segment;
    for (t, [x, y]) in [0.0, 0.5, 1.0].into_iter().zip(points) {
        let miss = (segment.eval(t) - Point::new(x, y, 0.0)).norm();
        assert!(miss < 1e-12, "{entities}\nat {t}: {:?}, expected {x}, {y}", segment.eval(t));
    }
    assert!((segment.length() - length).abs() < 1e-12, "{entities}: {}", segment.length());
}

fn trimmed(basis: &str, trim_1: &str, trim_2: &str, sense: &str, master: &str) -> String {
    let points = "#30=IFCCARTESIANPOINT((1.,2.));#31=IFCCARTESIANPOINT((-1.,0.));#32=IFCCARTESIANPOINT((1.,6.));";
    let trim = |trim: &str| match trim.split_once(' ') {
        Some((point, parameter)) => format!("({point},IFCPARAMETERVALUE({parameter}))"),
        None if trim.starts_with('#') => format!("({trim})"),
        None => format!("(IFCPARAMETERVALUE({trim}))"),
    };
    format!("{basis}{points}#100=IFCTRIMMEDCURVE(#20,{},{},.{sense}.,.{master}.);", trim(trim_1), trim(trim_2))
}

#[test]
fn arcs_follow_their_trims_senses_and_units() {
    let h = 2_f64.sqrt();
    // Seen from the centre, 0 is +y, a quarter turn is −x. Points #30 at 0, #31 at a quarter.
    let quarter = [[1.0, 2.0], [1.0 - h, h], [-1.0, 0.0]];
    let back = [[-1.0, 0.0], [1.0 - h, h], [1.0, 2.0]];
    let three = [[1.0, 2.0], [1.0 + h, -h], [-1.0, 0.0]];
    for (units, scale, first, second) in [(DEGREES, 1e-3, "0.", "90."), (RADIANS, 1.0, "0.", "1.5707963267948966")] {
        let at = |points: [[f64; 2]; 3]| points.map(|point| point.map(|value| value * scale));
        let arc = |a: &str, b: &str, sense: &str, master: &str| trimmed(CIRCLE, a, b, sense, master);
        check(units, &arc(first, second, "T", "PARAMETER"), at(quarter), PI * scale);
        check(units, &arc(second, first, "F", "PARAMETER"), at(back), PI * scale);
        check(units, &arc(first, second, "F", "PARAMETER"), at(three), 3.0 * PI * scale);
        check(units, &arc("#30", "#31", "T", "CARTESIAN"), at(quarter), PI * scale);
        check(units, &arc("#30", "#31", "T", "PARAMETER"), at(quarter), PI * scale);
        check(
            units,
            &arc("#31", second, "T", "UNSPECIFIED"),
            at([[-1.0, 0.0], [3.0, 0.0], [-1.0, 0.0]]),
            4.0 * PI * scale,
        );
    }
}

#[test]
fn the_master_decides_where_point_and_parameter_differ() {
    let h = 2_f64.sqrt() * 1e-3;
    let quarter = [[0.001, 0.002], [0.001 - h, h], [-0.001, 0.0]];
    let half = [[0.001, 0.002], [-0.001, 0.0], [0.001, -0.002]];
    check(DEGREES, &trimmed(CIRCLE, "#30 0.", "#31 180.", "T", "CARTESIAN"), quarter, PI * 1e-3);
    check(DEGREES, &trimmed(CIRCLE, "#30 0.", "#31 180.", "T", "PARAMETER"), half, 2.0 * PI * 1e-3);
    check(DEGREES, &trimmed(CIRCLE, "#30 0.", "#31 180.", "T", "UNSPECIFIED"), half, 2.0 * PI * 1e-3);
}

#[test]
fn arcs_cross_the_seam_and_close() {
    let half = [[3.0, 0.0], [1.0, 2.0], [-1.0, 0.0]].map(|point| point.map(|value| value * 1e-3));
    check(DEGREES, &trimmed(CIRCLE, "270.", "90.", "T", "PARAMETER"), half, 2.0 * PI * 1e-3);
    check(DEGREES, &trimmed(CIRCLE, "-90.", "450.", "T", "PARAMETER"), half, 2.0 * PI * 1e-3);
    let around = [[0.001, 0.002], [0.001, -0.002], [0.001, 0.002]];
    check(DEGREES, &trimmed(CIRCLE, "0.", "360.", "T", "PARAMETER"), around, 4.0 * PI * 1e-3);
    check(DEGREES, &trimmed(CIRCLE, "#30", "#30", "F", "CARTESIAN"), around, 4.0 * PI * 1e-3);
    check(DEGREES, &CIRCLE.replace("#20=", "#100="), around, 4.0 * PI * 1e-3);
    // A short arc is no full circle (1e-5° at 2 mm: 0.35 nm, at 2 km: 0.35 mm).
    let short = trimmed(CIRCLE, "0.", "0.00001", "T", "PARAMETER").replace("(#12,2.)", "(#12,2000000.)");
    let length = pieces(DEGREES, &short)[0].segment.length();
    assert!((length - 2000.0 * 1e-5 * PI / 180.0).abs() < 1e-12, "{length}");
}

#[test]
fn lines_count_in_magnitudes_of_their_vector() {
    let line = |a: &str, b: &str, sense: &str| trimmed(LINE, a, b, sense, "PARAMETER");
    check(RADIANS, &line("1.", "3.", "T"), [[1.0, 2.0], [1.0, 4.0], [1.0, 6.0]], 4.0);
    check(RADIANS, &line("3.", "1.", "F"), [[1.0, 6.0], [1.0, 4.0], [1.0, 2.0]], 4.0);
    check(RADIANS, &line("#30", "#32", "T"), [[1.0, 2.0], [1.0, 4.0], [1.0, 6.0]], 4.0);
    // Against the standard's order: the flag decides.
    check(RADIANS, &line("1.", "3.", "F"), [[1.0, 6.0], [1.0, 4.0], [1.0, 2.0]], 4.0);
    let off = message(RADIANS, &line("#31", "#32", "T"));
    assert!(off.contains("#100 IFCTRIMMEDCURVE: the point of Trim1 lies 2000.000000 mm off the curve #20"), "{off}");
    let none = message(RADIANS, &line("2.", "2.", "T"));
    assert!(none.contains("#100 IFCTRIMMEDCURVE: a segment of 0e0 m has no direction"), "{none}");
}

#[test]
fn a_trimmed_curve_of_a_trimmed_curve_counts_from_the_inner_one() {
    let nested = |inner: &str, trims: &str, sense: &str| {
        let inner = trimmed(CIRCLE, inner, "270.", "T", "PARAMETER").replace("#100=", "#40=");
        format!("{inner}#100=IFCTRIMMEDCURVE(#40,{trims},.{sense}.,.PARAMETER.);")
    };
    let half = [[-1.0, 0.0], [1.0, -2.0], [3.0, 0.0]].map(|point| point.map(|value| value * 1e-3));
    let reversed = [half[2], half[1], half[0]];
    let by_parameter = "(IFCPARAMETERVALUE(0.)),(IFCPARAMETERVALUE(180.))";
    check(DEGREES, &nested("90.", by_parameter, "T"), half, 2.0 * PI * 1e-3);
    check(DEGREES, &nested("90.", "(IFCPARAMETERVALUE(180.)),(IFCPARAMETERVALUE(0.))", "F"), reversed, 2.0 * PI * 1e-3);
    // By point, with an inner curve that begins before the point
    let to_end = "(#31),(IFCPARAMETERVALUE(270.))";
    check(DEGREES, &nested("0.", to_end, "T"), half, 2.0 * PI * 1e-3);
    // An inner curve run backwards: 270° down to 0°
    let inner = trimmed(CIRCLE, "270.", "0.", "F", "PARAMETER").replace("#100=", "#40=");
    let outer = "#100=IFCTRIMMEDCURVE(#40,(IFCPARAMETERVALUE(0.)),(IFCPARAMETERVALUE(180.)),.T.,.PARAMETER.);";
    check(DEGREES, &format!("{inner}{outer}"), reversed, 2.0 * PI * 1e-3);
    let outside = message(DEGREES, &nested("90.", "(IFCPARAMETERVALUE(0.)),(IFCPARAMETERVALUE(181.))", "T"));
    assert!(outside.contains("attribute Trim2: expected a place on the trimmed curve #40"), "{outside}");
}

#[test]
fn senses_compose_in_composites_of_composites() {
    // A quarter arc, backwards by sense and backwards again: forward. Then a line, all reversed by the outer composite.
    let entities = trimmed(CIRCLE, "90.", "0.", "F", "PARAMETER").replace("#100=", "#40=")
        + "#41=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.F.,#40);#50=IFCCARTESIANPOINT((-1.,0.));#51=IFCCARTESIANPOINT((-1.,-3.));\
           #52=IFCPOLYLINE((#50,#51));#53=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,#52);\
           #60=IFC2DCOMPOSITECURVE((#41,#53),.F.);#61=IFCCOMPOSITECURVESEGMENT(.DISCONTINUOUS.,.F.,#60);\
           #100=IFCCOMPOSITECURVE((#61),.F.);";
    let pieces = pieces(DEGREES, &entities);
    assert_eq!(pieces.iter().map(|piece| piece.entity).collect::<Vec<_>>(), [52, 40]);
    let ends = [[-1.0, -3.0], [-1.0, 0.0], [1.0, 2.0]].map(|[x, y]| Point::new(x, y, 0.0) * 1e-3);
    assert!((pieces[0].segment.start() - ends[0]).norm() < 1e-15);
    assert!((pieces[1].segment.start() - ends[1]).norm() < 1e-15);
    assert!((pieces[1].segment.end() - ends[2]).norm() < 1e-15);
}

#[test]
fn a_gap_beyond_the_precision_is_refused_with_both_entities() {
    let with_gap = |gap: &str| {
        format!(
            "#50=IFCCARTESIANPOINT((0.,0.));#51=IFCCARTESIANPOINT((1.,0.));#52=IFCCARTESIANPOINT((1.,{gap}));\
             #53=IFCCARTESIANPOINT((1.,2.));\n#60=IFCPOLYLINE((#50,#51));\n#61=IFCPOLYLINE((#52,#53));\
             #62=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,#60);#63=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,#61);\
             #100=IFCCOMPOSITECURVE((#62,#63),.F.);"
        )
    };
    for (gap, precision, meets) in [
        ("0.0000009", None, true),
        ("0.0000011", None, false),
        ("0.000004", Some(1e-5), true),
        ("0.000011", Some(1.0), false),
        ("0.00000002", Some(1e-8), false),
        ("0.0000000009", Some(0.0), true),
    ] {
        let found = read(RADIANS, &with_gap(gap), precision);
        assert_eq!(found.is_ok(), meets, "gap {gap}, precision {precision:?}");
        if let Err(error) = found {
            assert!(matches!(&error, ModelError::Gap { next, previous: 60, .. } if next.id == 61), "{error}");
        }
    }
    let shown = message(RADIANS, &with_gap("0.5"));
    let expected = "curve.ifc:4:1: #61 IFCPOLYLINE: starts 500.000000 mm from where #60 IFCPOLYLINE (line 3) ends";
    assert!(shown.starts_with(expected), "{shown}");
}

#[test]
fn splines_come_with_multiplicities_and_weights() {
    // A quarter circle of radius 1 as rational quadratic (Piegl, Tiller: The NURBS Book, example 7.2).
    let points = "#50=IFCCARTESIANPOINT((1.,0.));#51=IFCCARTESIANPOINT((1.,1.));#52=IFCCARTESIANPOINT((0.,1.));";
    let common = "2,(#50,#51,#52),.UNSPECIFIED.,.F.,.F.,(3,3),(0.,1.),.UNSPECIFIED.";
    let h = 0.5_f64.sqrt();
    let rational = format!("{points}#100=IFCRATIONALBSPLINECURVEWITHKNOTS({common},(1.,{h},1.));");
    check(RADIANS, &rational, [[1.0, 0.0], [h, h], [0.0, 1.0]], PI / 2.0);
    // Without weights a parabola: at ½ (¾, ¾); its length is √2/2·(√2 + ln(1 + √2))... of (1−u², 2u−u²).
    let parabola = pieces(RADIANS, &format!("{points}#100=IFCBSPLINECURVEWITHKNOTS({common});"));
    assert!((parabola[0].segment.eval(0.5) - Point::new(0.75, 0.75, 0.0)).norm() < 1e-12);
    for (bad, expected) in [
        (common.replace("(3,3)", "(3,2)"), "a B-spline with 5 knots"),
        (common.replace("(3,3)", "(3,4000000000)"), "multiplicities from 1 to degree + 1 = 3, found 4000000000"),
        (common.replace("(3,3)", "(3)"), "1 multiplicities for 2 knots"),
        (common.replace("2,(#50", "-2,(#50"), "attribute Degree: expected a whole number, not negative, found -2"),
        (common.replace("(0.,1.)", "(1.,0.)"), "knots must not decrease"),
    ] {
        let shown = message(RADIANS, &format!("{points}#100=IFCBSPLINECURVEWITHKNOTS({bad});"));
        assert!(shown.contains(expected), "{shown}");
    }
}

#[test]
fn indexed_curves_have_lines_and_arcs_through_three_points() {
    let points = "#50=IFCCARTESIANPOINTLIST3D(((0.,0.,5.),(1.,0.,5.),(2.,1.,5.),(1.,2.,5.),(0.,2.,5.)));";
    let found = pieces(
        RADIANS,
        &format!(
            "{points}#100=IFCINDEXEDPOLYCURVE(#50,(IFCLINEINDEX((1,2)),IFCARCINDEX((2,3,4)),IFCLINEINDEX((4,5,1))),.F.);"
        ),
    );
    // The arc is half a circle around (1, 1, 5), turning left.
    let lengths: Vec<_> = found.iter().map(|piece| piece.segment.length()).collect();
    for (length, expected) in lengths.iter().zip([1.0, PI, 1.0, 2.0]) {
        assert!((length - expected).abs() < 1e-12, "{lengths:?}");
    }
    assert_eq!(found.len(), 4);
    assert!((found[1].segment.eval(0.5) - Point::new(2.0, 1.0, 5.0)).norm() < 1e-12);
    assert!((found[1].segment.start() - Point::new(1.0, 0.0, 5.0)).norm() < 1e-12);
    let plain = pieces(RADIANS, &format!("{points}#100=IFCINDEXEDPOLYCURVE(#50,$,.F.);"));
    assert_eq!(plain.len(), 4);
    for (segments, expected) in [
        ("IFCARCINDEX((1,2,9))", "with indices of points, found IFCARCINDEX"),
        ("IFCLINEINDEX((0,1))", "with indices of points"),
        ("IFCARCINDEX((1,2,1))", "lie on one line or coincide"),
        ("IFCLINEINDEX((1,2)),IFCLINEINDEX((3,4))", "segment 2 does not start where"),
    ] {
        let shown = message(RADIANS, &format!("{points}#100=IFCINDEXEDPOLYCURVE(#50,({segments}),.F.);"));
        assert!(shown.contains(expected), "{shown}");
    }
}

#[test]
fn an_arc_through_three_points_turns_the_long_way_where_it_must() {
    // From (1, 0) over (0, −1) and on to (0, 1): three quarters, clockwise; in a tilted plane.
    let tilt = |x: f64, y: f64| format!("({x},{},{})", 0.6 * y, 0.8 * y);
    let entities = format!(
        "#50=IFCCARTESIANPOINTLIST3D(({},{},{}));#100=IFCINDEXEDPOLYCURVE(#50,(IFCARCINDEX((1,2,3))),.F.);",
        tilt(1.0, 0.0),
        tilt(-0.6, -0.8),
        tilt(0.0, 1.0)
    );
    let arc = &pieces(RADIANS, &entities)[0].segment;
    assert!((arc.length() - 1.5 * PI).abs() < 1e-12, "{}", arc.length());
    assert!((arc.eval(1.0 / 3.0) - Point::new(0.0, -0.6, -0.8)).norm() < 1e-12);
    assert!(arc.distance_to(&Point::new(-0.6, -0.48, -0.64)) < 1e-12);
}

#[test]
fn other_curves_are_unsupported_segments() {
    let ellipse = "#10=IFCCARTESIANPOINT((1.,0.));#12=IFCAXIS2PLACEMENT2D(#10,$);\n#20=IFCELLIPSE(#12,2.,1.);\
                   #100=IFCTRIMMEDCURVE(#20,(IFCPARAMETERVALUE(0.)),(IFCPARAMETERVALUE(1.)),.T.,.PARAMETER.);";
    let shown = message(RADIANS, ellipse);
    let expected =
        "curve.ifc:3:1: #20 IFCELLIPSE: unsupported segment in 'Layer 1'; write it as IfcTrimmedCurve of IfcCircle";
    assert!(shown.starts_with(expected), "{shown}");
    let shown = message(RADIANS, "#100=IFCCLOTHOID($,1.);");
    assert!(shown.contains("#100 IFCCLOTHOID: unsupported segment in 'Layer 1'"), "{shown}");
}

#[test]
fn curves_that_contain_themselves_end_in_an_error() {
    let circle = "#10=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,#100);#100=IFCCOMPOSITECURVE((#10,#10),.F.);";
    assert!(message(RADIANS, circle).contains("nested deeper than 32"));
    let trims = "(IFCPARAMETERVALUE(0.)),(IFCPARAMETERVALUE(1.)),.T.,.PARAMETER.";
    let circle = format!("#100=IFCTRIMMEDCURVE(#100,{trims});");
    assert!(message(RADIANS, &circle).contains("nested deeper than 32"));
    // Thirty doublings of one line: refused by their number, not tried.
    let mut doubling =
        "#50=IFCCARTESIANPOINT((0.,0.));#51=IFCCARTESIANPOINT((1.,0.));#70=IFCPOLYLINE((#50,#51,#50));".to_owned();
    for level in 70..100 {
        let next = level + 1;
        doubling += &format!("#{}=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,#{level});", level + 200);
        doubling += &format!("#{next}=IFCCOMPOSITECURVE((#{0},#{0}),.F.);", level + 200);
    }
    assert!(message(RADIANS, &doubling).contains("more than 1000000 segments"));
}
