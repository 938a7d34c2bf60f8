//! Texts of a few known values, as enums.

/// The words of a type: a variant for each, and one for those of a later version of the protocol.
macro_rules! words {
    ($name:ident { $($variant:ident = $word:tt),+ $(,)? }) => {
        /// A word of the wire.
        #[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
        #[non_exhaustive]
        pub enum $name {
            $(
                #[doc = concat!("`", $word, "`.")]
                #[serde(rename = $word)]
                $variant,
            )+
            /// A word of a later version of the protocol.
            #[serde(untagged)]
            Later(String),
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(match self {
                    $(Self::$variant => $word,)+
                    Self::Later(word) => word,
                })
            }
        }
    };
}

pub(super) use words;
