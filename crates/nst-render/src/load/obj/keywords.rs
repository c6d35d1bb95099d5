//! The keywords of OBJ files.

/// What a statement is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Statement {
    Vertex,
    Texture,
    Normal,
    Face,
    ObsoleteFace,
    Material,
    Library,
    /// Points, lines, curves and surfaces.
    Element,
    /// What would read other files, or run programs.
    Call,
    /// Names of objects and groups, smoothing groups, and all that belongs to curves and
    /// surfaces, or says how others draw.
    Harmless,
}

impl Statement {
    /// The statement of a keyword; `None` if it is unknown. They are those of the format's
    /// specification (Wavefront, Advanced Visualizer, 1995, appendix B1), with those that it
    /// calls superseded.
    pub(super) fn of(keyword: &str) -> Option<Self> {
        Some(match keyword {
            "v" => Self::Vertex,
            "vt" => Self::Texture,
            "vn" => Self::Normal,
            "f" => Self::Face,
            "fo" => Self::ObsoleteFace,
            "usemtl" => Self::Material,
            "mtllib" => Self::Library,
            "p" | "l" | "curv" | "curv2" | "surf" | "bsp" | "bzp" | "cdc" | "cdp" => Self::Element,
            "call" | "csh" => Self::Call,
            "o" | "g" | "s" | "mg" | "vp" | "cstype" | "deg" | "bmat" | "step" | "parm"
            | "trim" | "hole" | "scrv" | "sp" | "end" | "con" | "res" | "bevel" | "c_interp"
            | "d_interp" | "lod" | "ctech" | "stech" | "shadow_obj" | "trace_obj" | "usemap"
            | "maplib" => Self::Harmless,
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keywords_are_in_lower_case() {
        assert_eq!(Statement::of("f"), Some(Statement::Face));
        assert_eq!(Statement::of("curv2"), Some(Statement::Element));
        assert_eq!([Statement::of("F"), Statement::of("vertex"), Statement::of("")], [None; 3]);
    }
}
