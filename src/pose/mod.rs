//! The spine: points, skeletons, poses, rotations, kinematics. No I/O, no flags.
