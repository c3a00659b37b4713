//! Enums whose values have a word each: in options, messages and JSON.

/// Defines an enum with the word of each value.
macro_rules! vocabulary {
    ($(#[$about:meta])* pub enum $name:ident {
        $($(#[$about_value:meta])* $value:ident = $word:literal,)*
    }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[derive(serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $($(#[$about_value])* #[serde(rename = $word)] $value,)*
        }

        impl $name {
            /// All values, in the order of their codes.
            pub const ALL: [$name; [$($word),*].len()] = [$($name::$value),*];

            /// Returns the word for this value.
            pub fn word(self) -> &'static str {
                match self {
                    $($name::$value => $word),*
                }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.word())
            }
        }

        impl std::str::FromStr for $name {
            type Err = crate::Error;

            fn from_str(text: &str) -> crate::Result<$name> {
                let found = $name::ALL.into_iter().find(|value| value.word() == text);
                found.ok_or_else(|| {
                    let words = $name::ALL.map($name::word);
                    let [first @ .., last] = &words;
                    let first = first.join(", ");
                    crate::Error::Usage(format!("expected {first} or {last}"))
                })
            }
        }
    };
}
