//! The only place with clocks, sockets and threads.
