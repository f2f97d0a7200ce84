//! Wires the stages: bake, train, relight, optimise; progress and cancel.
