//! The bandwidth formulas of the three-role system, and the network simulator's home.
