//! The kernel's registration against figures of numpy's singular value decomposition
//! (`fixtures/data/registration.json`, which names its origin; `.ci/check_registration.py` compares fresh cases).

use nalgebra::{Matrix3, Vector3};
use screed_kernel::registration::{PointPair, register};
use serde_json::Value;

fn vector(value: &Value) -> Vector3<f64> {
    Vector3::from_fn(|row, _| value[row].as_f64().unwrap())
}

#[test]
fn registration_is_numpys() {
    let text = std::fs::read_to_string(screed_fixtures::data("registration.json")).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 24);
    for case in cases {
        let (outer, inner) = (case["in_outer_m"].as_array().unwrap(), case["in_inner_m"].as_array().unwrap());
        let pair = |(outer, inner)| PointPair { in_outer: vector(outer), in_inner: vector(inner) };
        let pairs: Vec<_> = outer.iter().zip(inner).map(pair).collect();
        let found = register(&pairs).unwrap();
        let rotation = Matrix3::from_fn(|row, column| case["rotation"][row][column].as_f64().unwrap());
        let miss = (found.outer_from_inner.rotation - rotation)
            .amax()
            .max((found.outer_from_inner.translation - vector(&case["translation_m"])).amax())
            .max((found.levers - vector(&case["levers_m"])).amax())
            .max((found.residual_rms - case["residual_rms_m"].as_f64().unwrap()).abs())
            .max((found.mirrored_rms - case["mirrored_rms_m"].as_f64().unwrap()).abs());
        // 1e-12, more only where the points hold a turn worse than to a tenth of the best.
        let tolerance = case["tolerance"].as_f64().unwrap();
        assert!(miss <= tolerance && tolerance < 1e-10, "{}: {miss:e}", case["family"]);
    }
}
