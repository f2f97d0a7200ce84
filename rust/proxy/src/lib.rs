//! Networks that learn the gather of one light type.
