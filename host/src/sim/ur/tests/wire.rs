//! A client that knows the protocol from its description alone, and a controller at the other end.

use crate::sim::ur::robot::Generation;
use crate::sim::ur::{ClientId, Controller, Options};
use screed_kernel::arm::Arm;
use screed_kernel::arms::ur::UR10E;
use screed_kernel::pose::Pose;
use screed_kernel::units::JointPos;

pub const START: JointPos<6> = JointPos([0.3, -1.2, 1.9, -2.2, -1.5, 0.1]);
/// A program that does nothing and goes on.
pub const IDLE: &str = "def test():\n  while True:\n    sync()\n  end\nend\n";

pub struct Wire {
    pub controller: Controller,
    pub client: ClientId,
    pub protocol: u16,
}

impl Wire {
    pub fn new(generation: Generation) -> Self {
        Self::of(&UR10E, START, generation, IDLE)
    }

    pub fn of(arm: &Arm<6>, start_q: JointPos<6>, generation: Generation, program: &str) -> Self {
        let options = Options {
            start_q,
            flange_from_tcp: Pose::identity(),
            register_offset: 0,
            program: program.to_owned(),
            autoplay: true,
            generation,
            powered: true,
        };
        let mut controller = Controller::new(arm, options).expect("legal");
        let client = controller.connect();
        Self { controller, client, protocol: 1 }
    }

    pub fn send(&mut self, kind: u8, payload: &[u8]) {
        let mut bytes = ((payload.len() + 3) as u16).to_be_bytes().to_vec();
        bytes.push(kind);
        bytes.extend(payload);
        self.controller.handle_bytes(self.client, &bytes);
    }

    pub fn bytes(&mut self) -> Vec<u8> {
        let mut out = vec![0; 1 << 20];
        let count = self.controller.poll_transmit(self.client, &mut out);
        out.truncate(count);
        out
    }

    /// Types and contents of the packages that have come.
    pub fn packages(&mut self) -> Vec<(u8, Vec<u8>)> {
        let (bytes, mut found) = (self.bytes(), Vec::new());
        let mut rest = bytes.as_slice();
        while let [high, low, kind, ..] = *rest {
            let size = usize::from(u16::from_be_bytes([high, low]));
            found.push((kind, rest[3..size].to_vec()));
            rest = &rest[size..];
        }
        assert!(rest.is_empty());
        found
    }

    /// The only package that comes, of the type that was sent.
    pub fn ask(&mut self, kind: u8, payload: &[u8]) -> Vec<u8> {
        self.send(kind, payload);
        let found = self.packages();
        assert_eq!(found.iter().map(|(kind, _)| *kind).collect::<Vec<_>>(), [kind], "{found:?}");
        found.into_iter().next().expect("one").1
    }

    pub fn protocol(&mut self, version: u16) {
        assert_eq!(self.ask(b'V', &version.to_be_bytes()), [1]);
        self.protocol = version;
    }

    /// The answer to a list of outputs: recipe and types.
    pub fn outputs(&mut self, names: &str, rate: f64) -> (u8, String) {
        if self.protocol == 1 {
            return (0, String::from_utf8(self.ask(b'O', names.as_bytes())).expect("text"));
        }
        let mut payload = rate.to_be_bytes().to_vec();
        payload.extend(names.bytes());
        self.recipe(b'O', &payload)
    }

    pub fn inputs(&mut self, names: &str) -> (u8, String) {
        self.recipe(b'I', names.as_bytes())
    }

    fn recipe(&mut self, kind: u8, payload: &[u8]) -> (u8, String) {
        let answer = self.ask(kind, payload);
        (answer[0], String::from_utf8(answer[1..].to_vec()).expect("text"))
    }

    pub fn start(&mut self) {
        assert_eq!(self.ask(b'S', &[]), [1]);
    }

    /// Runs cycles; the content of each data package, its recipe's number apart.
    pub fn run(&mut self, cycles: usize) -> Vec<Vec<u8>> {
        let mut found = Vec::new();
        for _ in 0..cycles {
            self.controller.step();
            for (kind, mut content) in self.packages() {
                if kind == b'U' {
                    content.drain(..usize::from(self.protocol == 2));
                    found.push(content);
                }
            }
        }
        found
    }

    /// A client of protocol 2 that gets these at full rate, and the first of them.
    pub fn streaming(generation: Generation, names: &str) -> Self {
        let mut wire = Self::new(generation);
        wire.protocol(2);
        let rate = f64::from(generation.cycle_rate());
        assert_eq!(wire.outputs(names, rate).0, 1);
        wire.start();
        wire.run(20);
        wire
    }

    /// The next data package.
    pub fn next(&mut self) -> Vec<u8> {
        self.run(1).pop().expect("a package a cycle")
    }
}

pub fn double(bytes: &[u8], at: usize) -> f64 {
    f64::from_be_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))
}

pub fn int(bytes: &[u8], at: usize) -> i32 {
    i32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}
