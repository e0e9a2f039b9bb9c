//! An analytic clear sky.
