//! The kernel on a board, paced by the board's clock, with a host at the other end of a serial line: `screed print --board`.
//!
//! Runs in QEMU: `.ci/board` builds and starts it.
#![no_std]
#![no_main]

mod mps2;

use core::panic::PanicInfo;
use cortex_m_rt::entry;
use cortex_m_semihosting::hprintln;
use mps2::Board;
use screed_firmware::{BYTES_MAX, Drives, FollowingDrives, Node, START};
use screed_kernel::arms::ur::UR10E;

#[entry]
fn main() -> ! {
    static mut NODE: Node<6> = Node::new(&UR10E);
    let Some(mut board) = Board::take() else { panic!("the board is taken") };
    let mut drives = FollowingDrives(START);
    let mut taken = true;
    let mut bytes = [0; BYTES_MAX];
    loop {
        let missed = board.wait(NODE.period_ns());
        let heard = board.hear(&mut bytes);
        let begun = board.now();
        let found = Drives { actual: drives.0, ready: taken };
        let command = NODE.cycle(begun, missed, bytes.get(..heard).unwrap_or(&[]), &found);
        let ticked = board.now();
        taken = board.put_out(begun, heard, &command);
        drives.follow(&command);
        let sent = board.now();
        NODE.report(ticked, sent, |frames| board.say(frames));
    }
}

/// Nothing is put out any more; drives that hear nothing stop.
#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    loop {
        cortex_m::asm::wfi();
    }
}
