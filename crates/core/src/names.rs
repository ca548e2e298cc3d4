//! Enums whose variants have names in flags, files and messages.

/// Gives an enum the names of its variants: `ALL`, `name` and `of_name`.
#[doc(hidden)]
#[macro_export]
macro_rules! names {
    ($type:ident { $($(#[$attribute:meta])* $variant:ident = $name:literal,)* }) => {
        impl $type {
            /// All variants, in order.
            pub const ALL: [$type; [$($(#[$attribute])* $name),*].len()] =
                [$($(#[$attribute])* $type::$variant),*];

            /// The name in flags, files and messages.
            pub fn name(self) -> &'static str {
                match self {
                    $($(#[$attribute])* $type::$variant => $name,)*
                }
            }

            /// The variant of a name.
            pub fn of_name(name: &str) -> Option<$type> {
                $type::ALL.into_iter().find(|one| one.name() == name)
            }
        }
    };
}
