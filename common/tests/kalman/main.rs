//! The filters: against another library, as sure as they should be, and what they survive.

mod consistency;
mod endurance;
mod model;
mod reference;
