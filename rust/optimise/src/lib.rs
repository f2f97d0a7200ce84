//! Solves light parameters by gradients through a relighter.
