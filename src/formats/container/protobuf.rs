//! Tables of protobuf messages.

/// Defines structs of messages: the number, the name, the type and the kind of each field. Tests
/// compare them with the schemas.
macro_rules! protobuf {
    ($($(#[$about:meta])* $name:ident {
        $($tag:tt $(#[$about_field:meta])* $field:ident: $type:ty, ($($kind:tt)*);)*
    })*) => {$(
        $(#[$about])*
        #[derive(Clone, PartialEq, ::prost::Message)]
        pub(crate) struct $name {
            $($(#[$about_field])* #[prost($($kind)*, tag = $tag)] pub $field: $type,)*
        }

        #[cfg(test)]
        #[allow(dead_code, reason = "not every message is compared with a schema")]
        impl $name {
            /// Name, number and kind of each field.
            pub const FIELDS: &[(&str, i32, &str)] =
                &[$((stringify!($field), $tag, stringify!($($kind)*))),*];
        }
    )*};
}

pub(crate) use protobuf;

#[cfg(test)]
pub(crate) mod tests {
    use prost::Message;
    use std::collections::BTreeSet;

    // Parts of `google.protobuf.FileDescriptorSet`.
    protobuf! {
        Files {
            1 file: Vec<File>, (message, repeated);
        }

        File {
            4 messages: Vec<Type>, (message, repeated);
            5 enumerations: Vec<Enumeration>, (message, repeated);
        }

        Enumeration {
            1 name: String, (string);
            2 values: Vec<Value>, (message, repeated);
        }

        Value {
            1 name: String, (string);
            2 number: i32, (int32);
        }

        Type {
            1 name: String, (string);
            2 fields: Vec<Field>, (message, repeated);
        }

        Field {
            1 name: String, (string);
            3 number: i32, (int32);
            4 label: i32, (int32);
            5 kind: i32, (int32);
            17 optional: bool, (bool);
        }
    }

    /// Returns the kind of a field, in the words of prost.
    fn kind(field: &Field) -> String {
        let kind = match field.kind {
            1 => "double",
            2 => "float",
            3 => "int64",
            4 => "uint64",
            // An enumeration.
            5 | 14 => "int32",
            7 => "fixed32",
            8 => "bool",
            9 => "string",
            11 => "message",
            12 => "bytes = \"bytes\"",
            13 => "uint32",
            17 => "sint32",
            18 => "sint64",
            other => panic!("type {other}"),
        };
        match field.label {
            3 => format!("{kind}, repeated"),
            _ if field.optional || kind == "message" => format!("{kind}, optional"),
            _ => kind.into(),
        }
    }

    /// Returns the names of the fields that only the schema and only the struct of a message has.
    /// Asserts that all others have the same number and kind.
    pub fn differences(
        schemas: &[u8],
        message: &str,
        fields: &[(&str, i32, &str)],
    ) -> [Vec<String>; 2] {
        let files = Files::decode(schemas).unwrap();
        let mut messages = files.file.iter().flat_map(|f| &f.messages);
        let schema = messages.find(|m| m.name == message).expect(message);
        let schema = schema
            .fields
            .iter()
            .map(|f| (f.name.clone(), f.number, kind(f)));
        let schema: BTreeSet<_> = schema.collect();
        let fields = fields.iter().map(|(name, tag, kind)| {
            let name = name.trim_start_matches("r#");
            (name.to_owned(), *tag, (*kind).to_owned())
        });
        let fields: BTreeSet<_> = fields.collect();
        let only = [schema.difference(&fields), fields.difference(&schema)];
        let only = only.map(|all| all.map(|(name, ..)| name.clone()).collect::<Vec<_>>());
        let both = only[0].iter().find(|name| only[1].contains(name));
        assert_eq!(both, None, "{message} differs from its schema");
        only
    }

    /// Returns the values of an enumeration: number and name.
    pub fn values(schemas: &[u8], enumeration: &str) -> Vec<(i32, String)> {
        let files = Files::decode(schemas).unwrap();
        let mut all = files.file.iter().flat_map(|f| &f.enumerations);
        let found = all.find(|e| e.name == enumeration).expect(enumeration);
        let values = found.values.iter();
        values.map(|v| (v.number, v.name.clone())).collect()
    }
}
