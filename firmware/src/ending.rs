//! How a program that runs under QEMU ends: what went wrong is said by semihosting, and the emulator's exit code tells.

use core::panic::PanicInfo;
use cortex_m::asm::wfi;
use cortex_m_semihosting::debug::{self, EXIT_FAILURE, ExitStatus};
use cortex_m_semihosting::hprintln;

/// Says why, and ends with a failure.
pub fn fail(why: &str) -> ! {
    hprintln!("failed: {}", why);
    end(EXIT_FAILURE)
}

/// The emulator ends here; anything else sleeps.
pub fn end(status: ExitStatus) -> ! {
    debug::exit(status);
    loop {
        wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    fail("panic")
}
