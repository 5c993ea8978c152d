//! One recording in many formats: each gives the estimates of the plain one, or is
//! refused with a line that says why.
mod clock;
mod index;
mod refusals;
mod reported;
mod table;
mod time;
