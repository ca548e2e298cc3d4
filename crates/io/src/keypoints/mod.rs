//! Keypoints of pose estimators as JSON: OpenPose's `--write_json`, a frame per file, and lists of
//! MediaPipe's landmarks as scripts dump them, a take per file.
//!
//! Positions in space are read: `pose_keypoints_3d`, whose points with a confidence of 0 are
//! missing, and `pose_world_landmarks`. By MediaPipe's documentation these are in meters, their
//! origin is the middle of the hips, and z grows away from the camera; x and y go with the
//! picture's, y down. OpenPose documents neither unit nor axis.

mod file;
pub(crate) mod frame;
mod frames;
mod layouts;

pub(crate) use file::is_keypoints;
pub use file::read;

#[cfg(test)]
mod tests;
