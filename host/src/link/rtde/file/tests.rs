use super::*;

/// In the shape of the configuration of UR's example for a control loop.
const CONTROL: &str = r#"<?xml version="1.0"?>
<rtde_config>
	<recipe key="state">
		<field name="actual_TCP_pose" type="VECTOR6D"/>
		<field name="output_int_register_3" type="INT32"/>
	</recipe>

	<recipe key="pose">
		<field name="input_double_register_0" type="DOUBLE"/>
		<field name="input_double_register_1" type="DOUBLE"/>
		<field name="input_double_register_2" type="DOUBLE"/>
		<field name="input_double_register_3" type="DOUBLE"/>
		<field name="input_double_register_4" type="DOUBLE"/>
		<field name="input_double_register_5" type="DOUBLE"/>
	</recipe>

	<recipe key="alive">
		<field name="input_int_register_0" type="INT32"/>
	</recipe>
</rtde_config>"#;

/// In the shape of that for recording: a comment, and every type.
const RECORD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<rtde_config>
	<recipe key="out">
		<field name="timestamp" type="DOUBLE"/>
		<field name="actual_q" type="VECTOR6D"/>
		<field name="joint_mode" type="VECTOR6INT32"/>
		<field name="actual_tool_accelerometer" type="VECTOR3D"/>
<!--
		<field name="payload" type="DOUBLE"/>
	-->
		<field name="robot_mode" type="INT32"/>
		<field name="runtime_state" type="UINT32"/>
		<field name="actual_digital_input_bits" type="UINT64"/>
		<field name="tool_output_mode" type="UINT8"/>
		<field name="output_bit_register_64" type="BOOL"/>
		<field name="input_int_register_0" type="INT32"/>
		<field name="of_a_newer_controller" type="VECTOR6UINT32"/>
	</recipe>
</rtde_config>
"#;

fn read(text: &str) -> RecipeFile {
    parse("recipes.xml", text).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn recipes_are_read_in_order_with_their_types_and_lines() {
    let file = read(CONTROL);
    let keys: Vec<_> =
        file.recipes.iter().map(|recipe| (recipe.key.as_str(), recipe.is_input, recipe.fields.len())).collect();
    assert_eq!(keys, [("state", false, 2), ("pose", true, 6), ("alive", true, 1)]);
    assert_eq!(file.register_offsets(), Some(vec![0]));
    let alive = file.recipe("alive").expect("there").fields[0];
    assert_eq!(
        (alive.name.to_string().as_str(), alive.kind, alive.line),
        ("input_int_register_0", FieldType::Int32, 18)
    );
    assert_eq!(file.recipe_at(18).map(|recipe| recipe.key.as_str()), Some("alive"));
    assert_eq!((file.recipe_at(17), file.recipe("out")), (None, None));

    let file = read(RECORD);
    let fields: Vec<_> = file.outputs().map(|field| (field.name.to_string(), field.kind.name(), field.line)).collect();
    assert_eq!(fields.len(), 11);
    assert_eq!(fields[4], ("robot_mode".to_owned(), "INT32", 11));
    assert_eq!(fields[9], ("input_int_register_0".to_owned(), "INT32", 16));
    assert_eq!(fields[10], ("of_a_newer_controller".to_owned(), "VECTOR6UINT32", 17));
    assert_eq!(file.register_offsets(), None);
}

#[test]
fn the_registers_of_the_inputs_say_where_screed_writes() {
    let moved = |double: &str, int: &str| {
        let text = CONTROL.replace("input_double_register_", double).replace("input_int_register_", int);
        read(&text).register_offsets()
    };
    assert_eq!(moved("input_double_register_", "input_int_register_1"), Some(vec![]));
    assert_eq!(moved("input_double_register_1", "input_int_register_"), Some(vec![]));
    assert_eq!(moved("input_double_register_2", "input_int_register_2"), Some(vec![]));
    let upper = (0..6).fold(CONTROL.replace("int_register_0", "int_register_24"), |text, n| {
        text.replace(&format!("double_register_{n}\""), &format!("double_register_{}\"", n + 24))
    });
    assert_eq!(read(&upper).register_offsets(), Some(vec![24]));
    let slider = "<rtde_config><recipe key='a'><field name='speed_slider_mask' type='UINT32'/></recipe></rtde_config>";
    assert_eq!((read(slider).register_offsets(), read(slider).recipes[0].is_input), (None, true));
}

/// What is wrong once `from` of [`CONTROL`] is `to`: line, and text.
fn wrong(from: &str, to: &str) -> (usize, String) {
    assert!(CONTROL.contains(from));
    match parse("recipes.xml", &CONTROL.replacen(from, to, 1)) {
        Err(FileError::Invalid { place, fault }) => {
            assert_eq!(place.file, "recipes.xml");
            (place.line, fault.to_string())
        }
        other => panic!("{from:?} -> {to:?} gave {other:?}"),
    }
}

#[test]
fn what_is_wrong_is_named_with_line_recipe_field_expected_and_found() {
    let cases = [
        (
            r#"actual_TCP_pose" type="VECTOR6D"#,
            r#"actual_TCP_pose" type="VECTOR3D"#,
            (4, "recipe state, field actual_TCP_pose: expected type VECTOR6D, found VECTOR3D"),
        ),
        (
            r#"input_int_register_0" type="INT32"#,
            r#"input_int_register_0" type="UINT32"#,
            (18, "recipe alive, field input_int_register_0: expected type INT32, found UINT32"),
        ),
        (
            r#"actual_TCP_pose" type="VECTOR6D"#,
            r#"of_tomorrow" type="FLOAT"#,
            (
                4,
                "recipe state, field of_tomorrow: expected type BOOL, UINT8, UINT32, INT32, UINT64, DOUBLE, VECTOR3D, VECTOR6D, \
                 VECTOR6INT32, VECTOR6UINT32, found FLOAT",
            ),
        ),
        (r#" type="VECTOR6D""#, "", (4, "recipe state, field actual_TCP_pose: expected an attribute type, found none")),
        (r#"name="actual_TCP_pose""#, "", (4, "recipe state: expected an attribute name, found none")),
        (r#" key="pose""#, "", (8, "recipe: expected an attribute key, found none")),
        (r#"key="pose""#, r#"key="state""#, (8, "recipe state stands here for the second time: expected once")),
        (
            "output_int_register_3",
            "actual_TCP_pose",
            (5, "recipe state, field actual_TCP_pose stands here for the second time: expected once"),
        ),
        (
            r#"input_double_register_1" type="DOUBLE"#,
            r#"speed_slider_mask" type="UINT32"/><field name="payload" type="DOUBLE"#,
            (
                10,
                "recipe pose, field payload: expected an input, as the recipe's speed_slider_mask is one, found an output",
            ),
        ),
        (
            r#"actual_TCP_pose""#,
            r#"a,b""#,
            (4, "recipe state: expected a name of at most 48 letters, digits and underscores, found a,b"),
        ),
        ("<rtde_config>", "<rtde>", (20, "this is not XML: expected 'rtde' tag, not 'rtde_config' at 20:1")),
        (
            "<recipe key=\"alive\">",
            "<recipe key=\"alive\">x",
            (17, "recipe alive: expected elements field, found the text \"x\""),
        ),
        (
            "<recipe key=\"alive\">",
            "<recipe key=\"alive\" rate=\"1\">",
            (17, "recipe alive: expected key alone, found attribute rate"),
        ),
        (
            "\t\t<field name=\"input_int_register_0\" type=\"INT32\"/>",
            "<fields/>",
            (18, "recipe alive: expected elements field, found an element fields"),
        ),
        (
            "\t\t<field name=\"input_int_register_0\" type=\"INT32\"/>",
            "",
            (17, "recipe alive: expected at least one field, found none"),
        ),
    ];
    for (from, to, (line, text)) in cases {
        assert_eq!(wrong(from, to), (line, text.to_owned()), "{to}");
    }
    for (text, expected) in [
        ("<config/>", "the file: expected an element rtde_config, found config"),
        ("<rtde_config/>", "rtde_config: expected at least one recipe, found none"),
    ] {
        let error = parse("recipes.xml", text).expect_err("no recipes").to_string();
        assert_eq!(error, format!("recipes.xml:1:1: {expected}"));
    }
    let error = load(Path::new("/nowhere/recipes.xml")).expect_err("no file").to_string();
    assert!(error.starts_with("cannot read the recipes /nowhere/recipes.xml: "), "{error}");
}

#[test]
fn no_text_makes_the_reader_panic() {
    for text in [CONTROL, RECORD] {
        for (end, _) in text.char_indices() {
            assert!(parse("recipes.xml", &text[..end]).is_err() || text[end..].trim().is_empty());
        }
        let mut random = 0x5eed_0007_u64;
        for _ in 0..2_000 {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            let mut bytes = text.as_bytes().to_vec();
            let place = (random % bytes.len() as u64) as usize;
            bytes[place] = b"<>\"/&;='ax0_ \n"[(random >> 40) as usize % 14];
            let _ = parse("recipes.xml", &String::from_utf8_lossy(&bytes));
        }
    }
}

/// Editors of some systems write XML so.
#[test]
fn other_encodings_are_told_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recipes.xml");
    let text = "<rtde_config><recipe key=\"out\"><field name=\"timestamp\" type=\"DOUBLE\"/></recipe></rtde_config>";
    let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let marked = [&[0xff, 0xfe][..], &wide].concat();
    let big: Vec<u8> = [0xfe, 0xff].into_iter().chain(text.encode_utf16().flat_map(u16::to_be_bytes)).collect();
    let latin = [b"<!--\n\xfc-->", text.as_bytes()].concat();
    for (bytes, found) in
        [(wide, "found UTF-16"), (marked, "found UTF-16"), (big, "found UTF-16"), (latin, "bytes in line 2")]
    {
        std::fs::write(&path, bytes).unwrap();
        let failure: crate::failure::Failure = load(&path).unwrap_err().into();
        let told = failure.to_string();
        assert!(told.contains(found) && told.contains("remedy: save it as UTF-8"), "{told}");
    }
    std::fs::write(&path, ["\u{feff}", text].concat()).unwrap();
    assert_eq!(load(&path).unwrap().recipes.len(), 1);
}
