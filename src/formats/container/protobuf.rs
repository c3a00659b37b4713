//! Tables of protobuf messages.

/// Defines structs of messages: the number, the name, the type and the kind of each field.
macro_rules! protobuf {
    ($($(#[$about:meta])* $name:ident {
        $($tag:tt $(#[$about_field:meta])* $field:ident: $type:ty, ($($kind:tt)*);)*
    })*) => {$(
        $(#[$about])*
        #[derive(Clone, PartialEq, ::prost::Message)]
        pub(crate) struct $name {
            $($(#[$about_field])* #[prost($($kind)*, tag = $tag)] pub $field: $type,)*
        }
    )*};
}

pub(crate) use protobuf;
