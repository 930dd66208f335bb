//! Frames over datagrams: the state machine, without sockets or a clock.
#![allow(dead_code, reason = "work on the branch: the connection that uses these parts is not written yet")]

mod congestion;
mod packet;
mod ranges;
mod rtt;
mod wire;
