use super::*;
use crate::model::{ModelError, parse};
use screed_fixtures::{QuarterCircle, quarter_circle};

fn file(text: &str) -> File<'_> {
    File::parse("model.ifc", text.as_bytes()).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &[u8]) -> ModelError {
    File::parse("model.ifc", text).map(|_| ()).expect_err("must be refused")
}

/// A whole file around these data lines.
fn data(lines: &str) -> String {
    format!("ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n{lines}\nENDSEC;\nEND-ISO-10303-21;\n")
}

#[test]
fn what_real_files_do_is_accepted() {
    let text = "\u{feff}ISO-10303-21 ;\r\n/* no; 'quotes */HEADER;FILE_DESCRIPTION (\r\n('a','b')\r\n,'2;1');\r\n\
        FILE_SCHEMA\t( /* name */ ('IFC4X3_ADD2') ) ;\r\nDATA;\r\n#  7\r\n"
        .replace("#  7", "#7")
        + "= IFCX ( 'it''s; (odd) #9' , /* ; */ 3 ) ;\r\n#99999999999=IFCY();#8=IFCZ(#99999999999);\r\n"
        + "END-ISO-10303-21;\r\n\r\n";
    let file = file(&text);
    assert_eq!(file.schemas(), ["IFC4X3_ADD2"]);
    assert_eq!(file.instances().iter().map(|instance| instance.id).collect::<Vec<_>>(), [7, 8, 99_999_999_999]);
    let record = file.record_of(file.get(7).expect("#7")).expect("parses");
    assert_eq!(record.keyword, "IFCX");
    assert_eq!(record.text(0, "Text").expect("a string"), "it's; (odd) #9");
    assert_eq!(record.count(1, "Count").expect("a count"), 3);
    let span = file.get(99_999_999_999).expect("it").span.clone();
    assert_eq!(&text[span], "#99999999999=IFCY();");
    assert_eq!(file.all("IFCZ").count(), 1);
}

#[test]
fn every_kind_of_value_is_told_apart() {
    let text = data("#1=IFCA($,*,-12,+3,1.,-2.5E-03,.5,1E3,'',.UNSET_2.,\"0FA\",#4,(),((1,2),(3.)),IFCLABEL('x'));");
    let file = file(&text);
    let record = file.record_of(file.get(1).expect("#1")).expect("parses");
    let list = |values: &[Value<'static>]| Value::List(values.to_vec());
    let expected = [
        Value::Null,
        Value::Derived,
        Value::Integer(-12),
        Value::Integer(3),
        Value::Real(1.0),
        Value::Real(-0.0025),
        Value::Real(0.5),
        Value::Real(1000.0),
        Value::Text(b""),
        Value::Enum("UNSET_2"),
        Value::Binary("0FA"),
        Value::Ref(4),
        list(&[]),
        list(&[list(&[Value::Integer(1), Value::Integer(2)]), list(&[Value::Real(3.0)])]),
        Value::Typed("IFCLABEL", vec![Value::Text(b"x")]),
    ];
    assert_eq!(record.attributes, expected);
}

#[test]
fn complex_instances_and_the_sections_of_edition_3_are_read() {
    let text = "ISO-10303-21;HEADER;ENDSEC;ANCHOR;<a>=#1;ENDSEC;REFERENCE;#5=<b;c>;ENDSEC;\
                DATA('first',('S'));#1=(A(1)B('x',(2)) /* */ C());ENDSEC;DATA;#2=D();ENDSEC;END-ISO-10303-21;";
    let file = file(text);
    let parts = file.parts(file.get(1).expect("#1")).expect("parses");
    assert_eq!(
        parts.iter().map(|(keyword, values)| (*keyword, values.len())).collect::<Vec<_>>(),
        [("A", 1), ("B", 2), ("C", 0)]
    );
    assert!(matches!(file.record_of(file.get(1).expect("#1")), Err(ModelError::Unsupported { .. })));
    assert!(file.get(2).is_some() && file.schemas().is_empty());
}

#[test]
fn broken_text_is_refused_with_the_place() {
    let line_6 = |statement: &str| data(statement);
    for (text, line, column, message) in [
        (String::new(), 1, 1, "found the end of the file"),
        ("PK\u{3}\u{4}rest".to_owned(), 1, 1, "zip archive"),
        ("<?xml version='1.0'?>".to_owned(), 1, 1, "this is XML"),
        ("solid cube\n".to_owned(), 1, 1, "found 'solid cube'"),
        (
            line_6("#1=A('x);\n#2=B('y');\n"),
            6,
            1,
            "inside a string of entity #1 A, expected '''; it is cut short or this",
        ),
        (line_6("#1=A('x;"), 6, 1, "the file ends inside a string of entity #1 A"),
        (line_6("#1=A(1 /* x);"), 6, 1, "the file ends inside a comment"),
        (line_6("#1=A((1);"), 6, 9, "expected ')' before the statement's end, found ';'"),
        (line_6("#1=A(1)\n#2=B(2);"), 7, 1, "expected ';', found '#2=B(2);'"),
        (line_6("#1=A(1));"), 6, 8, "expected ';', found ');'"),
        (line_6("#1 A(1);"), 6, 4, "expected '=', found 'A(1);'"),
        (line_6("#x=A(1);"), 6, 1, "expected an entity's number below 2^64, found '#x=A(1);'"),
        (line_6("#18446744073709551616=A(1);"), 6, 1, "below 2^64"),
        (line_6("#1=a(1);"), 6, 4, "expected '(', found 'a(1);'"),
        (line_6("1=A(1);"), 6, 1, "expected an entity '#…='"),
        (line_6("#1=A(1);\n\n#2=B();\n#1=C();"), 9, 1, "#1 C: the number was used before, in line 6"),
    ] {
        let error = refused(text.as_bytes());
        let shown = error.to_string();
        assert!(shown.contains(message), "{text}: {shown}");
        let (found_line, found_column, span) = error.location().expect("a place");
        assert_eq!((found_line, found_column), (line, column), "{text}: {shown}");
        assert!(span.end <= text.len(), "{text}: {span:?}");
    }
}

#[test]
fn broken_attributes_are_refused_when_they_are_read() {
    for (attributes, message) in [
        ("1,", "expected a value, found ');"),
        ("1 2", "expected ',' or ')', found '2);"),
        ("1.E", "expected a finite number"),
        ("1E400", "expected a finite number"),
        ("nan", "expected a value"),
        ("1.#QNAN", "expected ',' or ')'"),
        ("9223372036854775808", "expected a whole number below 2^63"),
        ("+", "expected a whole number"),
        (".T", "expected an enumeration value in capitals and '.'"),
        (".t.", "expected an enumeration value"),
        ("\"G\"", "expected binary digits"),
        ("#", "expected an entity's number"),
        ("IFCLABEL", "expected '('"),
        ("@", "expected a value, found '@);"),
    ] {
        let text = data(&format!("#1=A({attributes});"));
        let file = file(&text);
        let error = file.record_of(file.get(1).expect("#1")).map(|_| ()).expect_err(attributes);
        assert!(error.to_string().contains(message), "{attributes}: {error}");
        assert_eq!(error.location().expect("a place").0, 6, "{attributes}");
    }
    let text = data(&format!("#1=A({}{});", "(".repeat(100_000), ")".repeat(100_000)));
    let file = file(&text);
    let error = file.record_of(file.get(1).expect("#1")).map(|_| ()).expect_err("too deep");
    assert!(error.to_string().contains("nested at most 64 deep"), "{error}");
}

#[test]
fn a_file_cut_anywhere_says_that_it_is_cut() {
    let text = quarter_circle(&QuarterCircle { layers: 1, ..QuarterCircle::default() });
    let whole = text.trim_end().len();
    let cuts = (0..whole).step_by(499).chain(whole - 300..whole).chain(0..300);
    for cut in cuts {
        let error = parse("model.ifc", &text.as_bytes()[..cut]).map(|_| ()).expect_err("cut");
        match &error {
            ModelError::Truncated { .. } => {}
            // Before the first line is complete it cannot be told from another format.
            ModelError::Syntax { .. } if cut < "ISO-10303-21".len() => {}
            other => panic!("cut at {cut}: {other}"),
        }
        assert!(error.location().is_some());
    }
    assert!(parse("model.ifc", &text.as_bytes()[..whole]).is_ok());
}

/// Bytes flipped, inserted, removed and doubled at random places must give a model or an error, never a panic or a hang.
#[test]
fn damaged_files_never_panic() {
    let text = quarter_circle(&QuarterCircle { layers: 2, ..QuarterCircle::default() }).into_bytes();
    let mut state = 0x5EED_u64;
    let mut random = move |below: usize| {
        // SplitMix64, as in the fixtures.
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) % below as u64) as usize
    };
    let (mut models, mut errors) = (0, 0);
    for _ in 0..2_000 {
        let mut damaged = text.clone();
        for _ in 0..1 + random(3) {
            let at = random(damaged.len());
            match random(5) {
                0 => damaged[at] = random(256) as u8,
                // Digits and signs keep the syntax and reach the geometry.
                1 => damaged[at] = b"0123456789.-+E#$*'(),;TF"[random(24)],
                2 => damaged.insert(at, b"0123456789.-+E#$*'(),;TF"[random(24)]),
                3 => {
                    let end = (at + 1 + random(200)).min(damaged.len());
                    damaged.drain(at..end);
                }
                _ => {
                    let end = (at + 1 + random(200)).min(damaged.len());
                    let copied = damaged[at..end].to_vec();
                    let to = random(damaged.len());
                    damaged.splice(to..to, copied);
                }
            }
        }
        match parse("model.ifc", &damaged) {
            Ok(_) => models += 1,
            Err(error) => {
                errors += 1;
                assert!(!error.to_string().is_empty());
            }
        }
    }
    // Damage to names and numbers goes unnoticed, damage to structure does not: both kinds must occur.
    assert!(models > 50 && errors > 800, "{models} models, {errors} errors");
}
