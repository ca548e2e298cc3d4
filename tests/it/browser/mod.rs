//! Every page that the commands write or serve, opened in headless Chromium: nothing goes wrong in
//! it, what it is for is drawn, and it answers mouse, fingers and keys.
//!
//! `CHROMIUM` names another browser; `SHOTS` a folder for pictures of the pages.

mod chromium;
mod edit;
mod night;
mod pages;
mod pair;
mod pair_label;
mod plot;
