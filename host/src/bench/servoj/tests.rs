use super::*;

#[test]
fn a_layer_is_enough_to_learn_a_servo_that_is_not_what_the_cell_says() {
    let without = run(&Case { rate_hz: 125, assumed: None }).unwrap_or_else(|error| panic!("{error}"));
    let with = run(&Case { rate_hz: 125, assumed: Some([0.7, 1.3]) }).unwrap_or_else(|error| panic!("{error}"));
    assert!(without.lag[1].max > 5e-3, "{without:?}");
    assert!(with.lag[1].max < report::AIM && with.contour[1].max <= without.contour[1].max, "{with:?}");
    assert!(with.lag[0].max < without.lag[0].max && with.behind < 5e-4, "{with:?}");
    // The demo's own layer, with what it has taught, from its first setpoint on.
    let [lag, contour] = with.again.unwrap_or_else(|| panic!("{with:?}"));
    assert!(lag.max < report::AIM && contour.max < 0.5 * without.contour[0].max, "{with:?}");
    assert!(
        report::met(
            Case { rate_hz: 125, assumed: Some([0.7, 1.3]) },
            &with,
            &[(Case { rate_hz: 125, assumed: None }, without)]
        ) == Some(true)
    );
    // The look-ahead of 100 ms, half a period that a target is held, and what of the dead time is not named.
    let learnt = with.learnt.map(|drive| drive.lag).unwrap_or_default();
    assert!((0.1..0.115).contains(&learnt), "{learnt}");
}
