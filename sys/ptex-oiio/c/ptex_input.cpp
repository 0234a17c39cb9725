// Ptex as OpenImageIO sees it: a subimage for every face, a MIP level for every halving of both its sides.
//
// What reads the file is behind ptex_border.h. It can be used by all threads at once, and nothing here changes while a
// file is open but `m_spec`, by seek_subimage, for which OpenImageIO's callers hold the lock of the base class. So the
// read_native_* calls, which may come from several threads, take none.
#include "ptex_border.h"

#include <cstring>
#include <string>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

namespace {

// Meta data that the format itself calls large are repeated for every face while all of that stays below this: with
// them each of 100,000 faces would carry along the whole mesh, if the file holds it.
constexpr size_t LARGE_ENTRY = 1024, MOST_REPEATED = size_t(1) << 20;

OIIO::TypeDesc::BASETYPE type_of(uint32_t type)
{
    switch (type) {
    case PTEX_BORDER_TEXT: return OIIO::TypeDesc::STRING;
    case PTEX_BORDER_INT8: return OIIO::TypeDesc::INT8;
    case PTEX_BORDER_INT16: return OIIO::TypeDesc::INT16;
    case PTEX_BORDER_INT32: return OIIO::TypeDesc::INT32;
    case PTEX_BORDER_UINT8: return OIIO::TypeDesc::UINT8;
    case PTEX_BORDER_UINT16: return OIIO::TypeDesc::UINT16;
    case PTEX_BORDER_HALF: return OIIO::TypeDesc::HALF;
    case PTEX_BORDER_FLOAT: return OIIO::TypeDesc::FLOAT;
    case PTEX_BORDER_DOUBLE: return OIIO::TypeDesc::DOUBLE;
    default: return OIIO::TypeDesc::UNKNOWN;
    }
}

class PtexInput final : public OIIO::ImageInput {
public:
    PtexInput() = default;
    ~PtexInput() override { close(); }

    const char* format_name() const override { return "ptex"; }
    int supports(OIIO::string_view feature) const override
    {
        return feature == "arbitrary_metadata" || feature == "ioproxy";
    }

    bool valid_file(const std::string& name) const override
    {
        char magic[4];
        return OIIO::Filesystem::read_bytes(name, magic, sizeof magic) == sizeof magic
               && std::memcmp(magic, "Ptex", sizeof magic) == 0;
    }

    bool open(const std::string& name, OIIO::ImageSpec& spec, const OIIO::ImageSpec& config) override
    {
        ioproxy_retrieve_from_config(config);
        return open(name, spec);
    }

    bool open(const std::string& name, OIIO::ImageSpec& spec) override
    {
        free_file();
        std::vector<uint8_t> bytes;
        if (ioproxy() && !read_all(*ioproxy(), bytes))
            return false;
        Message message;
        if (!done(ptex_border_open(name.c_str(), ioproxy() ? bytes.data() : nullptr, bytes.size(), &m_file,
                                   message.text, sizeof message.text),
                  message)
            || !done(ptex_border_info(m_file, &m_info, message.text, sizeof message.text), message)) {
            free_file();
            return false;
        }
        m_spec = OIIO::ImageSpec(1, 1, int(m_info.channels), OIIO::TypeDesc(type_of(m_info.type)));
        // Names by the number of channels, as for any image; but alpha is what the file says.
        m_spec.alpha_channel = m_info.alpha_channel;
        describe();
        if (!seek_subimage(0, 0)) {
            errorfmt("{}: the file has no faces", name);
            free_file();
            return false;
        }
        spec = m_spec;
        return true;
    }

    bool close() override
    {
        free_file();
        ioproxy_clear();
        return true;
    }

    int current_subimage() const override { return m_subimage; }
    int current_miplevel() const override { return m_level; }

    bool seek_subimage(int subimage, int level) override
    {
        if (!m_file || subimage < 0 || level < 0)
            return false;
        if (subimage == m_subimage && level == m_level)
            return true;
        PtexBorderSize size;
        // That there is no such face or level is how callers find out how many there are: no error.
        if (ptex_border_size(m_file, uint32_t(subimage), uint32_t(level), &size, nullptr, 0) != PTEX_BORDER_OK)
            return false;
        m_spec.width = m_spec.full_width = int(size.width);
        m_spec.height = m_spec.full_height = int(size.height);
        m_spec.tile_width                  = int(size.tile_width);
        m_spec.tile_height                 = int(size.tile_height);
        if (m_subimage < 0 || (subimage == 0) != (m_subimage == 0))
            m_spec.extra_attribs = subimage == 0 ? m_first : m_others;
        m_subimage = subimage;
        m_level    = level;
        return true;
    }

    bool read_native_scanline(int subimage, int level, int y, int z, void* data) override
    {
        return read_native_scanlines(subimage, level, y, y + 1, z, data);
    }

    bool read_native_scanlines(int subimage, int level, int begin, int end, int z, void* data) override
    {
        PtexBorderSize size;
        return find(subimage, level, size) && z == 0
               && read(subimage, level, 0, begin, size.width, uint32_t(end - begin), data);
    }

    bool read_native_tile(int subimage, int level, int x, int y, int z, void* data) override
    {
        PtexBorderSize size;
        return find(subimage, level, size) && z == 0
               && read(subimage, level, x, y, size.tile_width, size.tile_height, data);
    }

private:
    struct Message {
        char text[4096] = "";
    };

    PtexBorderFile* m_file = nullptr;
    PtexBorderInfo m_info  = {};
    int m_subimage = -1, m_level = -1;
    // The attributes of the first face, and of all others.
    OIIO::ParamValueList m_first, m_others;

    void free_file()
    {
        ptex_border_close(m_file);
        m_file     = nullptr;
        m_info     = {};
        m_subimage = m_level = -1;
        m_first.clear();
        m_others.clear();
    }

    bool done(int code, const Message& message) const
    {
        if (code != PTEX_BORDER_OK)
            errorfmt("{}", message.text);
        return code == PTEX_BORDER_OK;
    }

    bool read_all(OIIO::Filesystem::IOProxy& from, std::vector<uint8_t>& bytes) const
    {
        bytes.resize(from.size());
        // No bytes have no address, and null would ask for the file: nothing that short is Ptex anyhow.
        if (!bytes.empty() && from.pread(bytes.data(), bytes.size(), 0) == bytes.size())
            return true;
        errorfmt("{}: {}", from.filename(), from.error().empty() ? "it could not be read" : from.error());
        return false;
    }

    // The attributes of the faces.
    void describe()
    {
        OIIO::ImageSpec spec;
        spec.attribute("ptex:meshType", m_info.mesh_type);
        if (m_info.has_edits)
            spec.attribute("ptex:hasEdits", 1);
        const std::string wrap = std::string(m_info.u_border) + "," + m_info.v_border;
        // The first name is what readers of Ptex have come to expect, the second what texture systems look for.
        spec.attribute("wrapmode", wrap);
        spec.attribute("wrapmodes", wrap);
        // Says that the levels are those of a MIP map. Without it oiiotool cannot write a face to formats that have some.
        spec.attribute("textureformat", "Plain Texture");

        OIIO::ImageSpec others = spec;
        size_t large           = 0;
        for (size_t i = 0; i < m_info.meta_count; ++i)
            large += size_of(m_info.meta[i]) > LARGE_ENTRY ? size_of(m_info.meta[i]) : 0;
        const bool repeat = large <= MOST_REPEATED / m_info.faces;
        for (size_t i = 0; i < m_info.meta_count; ++i) {
            const PtexBorderMeta& meta = m_info.meta[i];
            add(meta, spec);
            if (repeat || size_of(meta) <= LARGE_ENTRY)
                add(meta, others);
        }
        m_first.swap(spec.extra_attribs);
        m_others.swap(others.extra_attribs);
    }

    static size_t size_of(const PtexBorderMeta& meta)
    {
        return meta.type == PTEX_BORDER_TEXT ? meta.count
                                             : meta.count * OIIO::TypeDesc(type_of(meta.type)).size();
    }

    static void add(const PtexBorderMeta& meta, OIIO::ImageSpec& spec)
    {
        const std::string key(meta.key, meta.key_size);
        if (meta.type == PTEX_BORDER_TEXT) {
            spec.attribute(key, std::string(static_cast<const char*>(meta.data), meta.count));
            return;
        }
        // An array of no numbers cannot be said: for OpenImageIO that is one number.
        if (meta.count > 0 && meta.count <= size_t(INT32_MAX))
            spec.attribute(key, OIIO::TypeDesc(type_of(meta.type), OIIO::TypeDesc::SCALAR, int(meta.count)),
                           meta.data);
    }

    bool find(int subimage, int level, PtexBorderSize& size) const
    {
        Message message;
        if (!m_file || subimage < 0 || level < 0) {
            errorfmt("no file is open, or face {} and level {} were asked for", subimage, level);
            return false;
        }
        return done(ptex_border_size(m_file, uint32_t(subimage), uint32_t(level), &size, message.text,
                                     sizeof message.text),
                    message);
    }

    bool read(int subimage, int level, int x, int y, uint32_t width, uint32_t height, void* data) const
    {
        Message message;
        const size_t bytes = size_t(width) * height * m_info.channels * OIIO::TypeDesc(type_of(m_info.type)).size();
        // Negative numbers become large ones, which are outside of any face.
        return done(ptex_border_read(m_file, uint32_t(subimage), uint32_t(level), uint32_t(x), uint32_t(y), width,
                                     height, data, bytes, message.text, sizeof message.text),
                    message);
    }
};

}  // namespace

extern "C" void* ptex_input_new(void)
{
    // OpenImageIO takes the result for its own class: the pointer has to be to the base.
    try {
        return static_cast<OIIO::ImageInput*>(new PtexInput);
    } catch (...) {
        return nullptr;
    }
}
