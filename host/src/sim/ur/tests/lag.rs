//! The lag of the model of `servoj` on both controllers, read off the wire.

use super::program;
use super::wire::{START, Wire, double};
use crate::sim::ur::robot::Generation;
use screed_kernel::arms::ur::UR10E;

/// The model of `servoj` against its own statement, not against a robot: on a ramp the joints are behind by the look-ahead
/// and the transport of two cycles, within one cycle. The setpoint that a register holds is half a cycle old on average.
#[test]
fn on_a_ramp_the_lag_is_look_ahead_and_transport_within_a_cycle_at_both_rates() {
    for (generation, rate) in [(Generation::ESeries, 500), (Generation::Cb3, 125)] {
        for lookahead in [0.03, 0.1, 0.2] {
            let text = program(rate, 0, lookahead).text().expect("a legal program");
            let mut wire = Wire::of(&UR10E, START, generation, &text);
            wire.protocol(2);
            wire.outputs("timestamp,actual_q", f64::from(rate));
            let registers: Vec<String> = (0..6).map(|register| format!("input_double_register_{register}")).collect();
            assert_eq!(wire.inputs(&format!("input_int_register_0,{}", registers.join(","))).0, 1);
            wire.start();
            wire.run(10);
            let (cycle, speed) = (1.0 / f64::from(rate), 0.2);
            let mut lag = 0.0;
            for step in 1..=4 * rate as i32 {
                let setpoint = START.0.map(|joint| joint + speed * cycle * f64::from(step));
                let mut data = vec![1];
                data.extend(step.to_be_bytes());
                data.extend(setpoint.iter().flat_map(|value| value.to_be_bytes()));
                wire.send(b'U', &data);
                lag = (setpoint[0] - double(&wire.next(), 8)) / speed;
            }
            let expected = lookahead + 2.0 * cycle;
            assert!((lag - expected).abs() <= cycle, "{generation:?}, look-ahead {lookahead}: {lag} s, not {expected}");
        }
    }
}
