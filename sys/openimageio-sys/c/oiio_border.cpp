#include "oiio_border.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/oiioversion.h>

namespace {

void copy_text(const std::string& from, char* to, size_t size)
{
    if (!to || size == 0)
        return;
    const size_t n = std::min(from.size(), size - 1);
    std::memcpy(to, from.data(), n);
    to[n] = 0;
}

// What leaves a body early: caught by `guarded`, it never leaves this file.
struct Failure {
    int code;
    std::string message;
};

// Runs a body and turns whatever it throws into a code and a message.
template<class Body> int guarded(int code, char* message, size_t message_size, Body body)
{
    try {
        copy_text("", message, message_size);
        body();
        return OIIO_BORDER_OK;
    } catch (const Failure& failure) {
        // Copying cannot throw: the text fits the caller's buffer or is cut.
        copy_text(failure.message, message, message_size);
        return failure.code;
    } catch (const std::bad_alloc&) {
        if (message && message_size > 0)
            std::snprintf(message, message_size, "out of memory");
        return OIIO_BORDER_NO_MEMORY;
    } catch (const std::exception& e) {
        if (message && message_size > 0)
            std::snprintf(message, message_size, "%s", e.what());
        return code;
    } catch (...) {
        if (message && message_size > 0)
            std::snprintf(message, message_size, "an unknown exception");
        return code;
    }
}

std::string or_unknown(std::string text)
{
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r'))
        text.pop_back();
    return text.empty() ? "no reason given" : text;
}

OIIO::TypeDesc type_of(uint32_t format)
{
    switch (format) {
    case OIIO_BORDER_UINT8: return OIIO::TypeDesc::UINT8;
    case OIIO_BORDER_HALF: return OIIO::TypeDesc::HALF;
    case OIIO_BORDER_FLOAT: return OIIO::TypeDesc::FLOAT;
    case OIIO_BORDER_UINT32: return OIIO::TypeDesc::UINT32;
    case OIIO_BORDER_UINT16: return OIIO::TypeDesc::UINT16;
    default: throw Failure { OIIO_BORDER_MISUSE, "unknown channel format" };
    }
}

uint32_t format_of(OIIO::TypeDesc type)
{
    switch (type.basetype) {
    case OIIO::TypeDesc::UINT8: return OIIO_BORDER_UINT8;
    case OIIO::TypeDesc::HALF: return OIIO_BORDER_HALF;
    case OIIO::TypeDesc::UINT32: return OIIO_BORDER_UINT32;
    default: return OIIO_BORDER_FLOAT;
    }
}

// A file for OpenImageIO to write to that does not forget an error. Writers may swallow one in a destructor; and
// OpenEXR may wait forever after some. So they never see it: what fails is remembered here, the
// rest is discarded, and the border asks after each of its calls.
class CheckedFile final : public OIIO::Filesystem::IOProxy {
public:
    explicit CheckedFile(const char* name)
        : OIIO::Filesystem::IOProxy(name, Write)
        , m_file(::open(name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666))
    {
        if (m_file < 0)
            throw Failure { OIIO_BORDER_CANNOT_WRITE, std::strerror(errno) };
    }
    ~CheckedFile() override
    {
        if (m_file >= 0)
            ::close(m_file);
    }
    CheckedFile(const CheckedFile&) = delete;
    CheckedFile& operator=(const CheckedFile&) = delete;

    const char* proxytype() const override { return "checkedfile"; }
    int64_t tell() override { return m_pos; }
    bool seek(int64_t offset) override
    {
        m_pos = offset;
        return true;
    }
    size_t write(const void* bytes, size_t size) override
    {
        pwrite(bytes, size, m_pos);
        m_pos += int64_t(size);
        return size;
    }
    size_t pwrite(const void* bytes, size_t size, int64_t offset) override
    {
        m_size              = std::max(m_size, offset + int64_t(size));
        const char* from    = static_cast<const char*>(bytes);
        size_t left         = size;
        while (left > 0 && m_errno == 0) {
            const ssize_t written = ::pwrite(m_file, from, left, off_t(offset));
            if (written < 0 && errno == EINTR)
                continue;
            if (written <= 0) {
                m_errno = written < 0 && errno != 0 ? errno : EIO;
                break;
            }
            from += written;
            offset += written;
            left -= size_t(written);
        }
        return size;
    }
    size_t size() const override { return size_t(m_size); }

    // Closes (network file systems tell their errors then); throws if this or any write failed.
    void finish()
    {
        const int file = m_file;
        m_file         = -1;
        if (file >= 0 && ::close(file) != 0 && errno != EINTR && m_errno == 0)
            m_errno = errno;
        check();
    }
    // Throws if any write failed.
    void check() const
    {
        if (m_errno != 0)
            throw Failure { OIIO_BORDER_CANNOT_WRITE, std::strerror(m_errno) };
    }

private:
    int m_file;
    int64_t m_size = 0;
    // The first error; it is the cause of the later ones.
    int m_errno = 0;
};

}  // namespace

struct OiioBorderInput {
    // Declared first, destroyed last: the reader looks into it.
    std::unique_ptr<OIIO::Filesystem::IOMemReader> memory;
    OIIO::ImageInput::unique_ptr input;

    OIIO::ImageSpec spec(uint32_t part, uint32_t level = 0)
    {
        if (!input->seek_subimage(int(part), int(level))) {
            (void)input->geterror();
            std::string what = "part " + std::to_string(part);
            if (level > 0)
                what = "level " + std::to_string(level) + " of " + what;
            throw Failure { OIIO_BORDER_ABSENT, "the file has no " + what };
        }
        return input->spec();
    }
};

struct OiioBorderOutput {
    // Declared first, destroyed last: the writer writes to it.
    std::unique_ptr<CheckedFile> file;
    std::vector<OIIO::ImageSpec> specs;
    OIIO::ImageOutput::unique_ptr output;
    std::string name;
    // A file in memory, or -1.
    int memory   = -1;
    size_t part  = 0;
    uint32_t row = 0;

    OiioBorderOutput()                                   = default;
    OiioBorderOutput(const OiioBorderOutput&)            = delete;
    OiioBorderOutput& operator=(const OiioBorderOutput&) = delete;
    ~OiioBorderOutput()
    {
        output.reset();
        if (memory >= 0)
            ::close(memory);
    }

    // Moves what was written to memory to the file.
    void copy_memory()
    {
        std::vector<char> buffer(1 << 20);
        for (off_t offset = 0;;) {
            const ssize_t count = ::pread(memory, buffer.data(), buffer.size(), offset);
            if (count < 0 && errno == EINTR)
                continue;
            if (count < 0)
                throw Failure { OIIO_BORDER_CANNOT_WRITE, std::strerror(errno) };
            if (count == 0)
                break;
            file->write(buffer.data(), size_t(count));
            file->check();
            offset += count;
        }
    }

    // The system's reason if there is one, else OpenImageIO's.
    [[noreturn]] void fail()
    {
        file->check();
        throw Failure { OIIO_BORDER_CANNOT_WRITE, or_unknown(output->geterror()) };
    }
};

void oiio_border_version(char* text, size_t text_size) { copy_text(OIIO_VERSION_STRING, text, text_size); }

int oiio_border_declare(const char* name, const char* const* endings, const char* version, void* (*create)(void),
                        char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_MISUSE, message, message_size, [&] {
        if (!name || !endings || !version || !create)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        // The pointer that it makes is one to ImageInput: only C has no name for that.
        OIIO::declare_imageio_format(name, reinterpret_cast<OIIO::ImageInput::Creator>(create),
                                     const_cast<const char**>(endings), nullptr, nullptr, version);
        // OpenImageIO takes a registry that is not empty for a complete one, when asked which formats it knows. A
        // format that is not in it yet makes it add all others.
        (void)OIIO::ImageInput::create("openexr");
    });
}

int oiio_border_open(const char* name, const uint8_t* bytes, size_t byte_count, OiioBorderInput** input,
                     char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_CANNOT_OPEN, message, message_size, [&] {
        if (!name || !input)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        *input      = nullptr;
        auto opened = std::make_unique<OiioBorderInput>();
        OIIO::ImageSpec config;
        config.attribute("oiio:UnassociatedAlpha", 1);
        if (bytes) {
            opened->memory = std::make_unique<OIIO::Filesystem::IOMemReader>(bytes, byte_count);
            // Some readers take it from the configuration only, others as an argument.
            void* proxy = static_cast<OIIO::Filesystem::IOProxy*>(opened->memory.get());
            config.attribute("oiio:ioproxy", OIIO::TypeDesc(OIIO::TypeDesc::PTR), &proxy);
        }
        opened->input = OIIO::ImageInput::open(name, &config, opened->memory.get());
        if (!opened->input)
            throw Failure { OIIO_BORDER_CANNOT_OPEN, or_unknown(OIIO::geterror()) };
        *input = opened.release();
    });
}

int oiio_border_info(OiioBorderInput* input, uint32_t part, uint32_t level, OiioBorderInfo* info, char* message,
                     size_t message_size)
{
    return guarded(OIIO_BORDER_BAD_IMAGE, message, message_size, [&] {
        if (!input || !info)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        const OIIO::ImageSpec spec = input->spec(part, level);
        if (spec.width <= 0 || spec.height <= 0 || spec.nchannels <= 0)
            throw Failure { OIIO_BORDER_BAD_IMAGE, "the image has no pixels: " + std::to_string(spec.width)
                                                       + " x " + std::to_string(spec.height) + ", "
                                                       + std::to_string(spec.nchannels) + " channels" };
        if (spec.depth > 1)
            throw Failure { OIIO_BORDER_BAD_IMAGE, "a volume, not a flat image" };
        if (spec.deep)
            throw Failure { OIIO_BORDER_BAD_IMAGE, "a deep image, not a flat one" };
        *info             = OiioBorderInfo {};
        info->width       = uint32_t(spec.width);
        info->height      = uint32_t(spec.height);
        info->x           = spec.x;
        info->y           = spec.y;
        info->full_width  = uint32_t(std::max(spec.full_width, 0));
        info->full_height = uint32_t(std::max(spec.full_height, 0));
        info->full_x      = spec.full_x;
        info->full_y      = spec.full_y;
        info->channels    = uint32_t(spec.nchannels);
        info->format      = format_of(spec.channelformat(0));
        for (int c = 0; c < spec.nchannels; ++c)
            if (format_of(spec.channelformat(c)) != info->format || info->format == OIIO_BORDER_UINT32)
                info->format = OIIO_BORDER_FLOAT;
        info->alpha_channel = spec.alpha_channel;
        info->depth_channel = spec.z_channel;
        copy_text(std::string(spec.get_string_attribute("oiio:ColorSpace")), info->color_space,
                  sizeof info->color_space);
    });
}

int oiio_border_channel(OiioBorderInput* input, uint32_t part, uint32_t channel, uint32_t* format, char* name,
                        size_t name_size, char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_BAD_IMAGE, message, message_size, [&] {
        if (!input || !format)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        const OIIO::ImageSpec spec = input->spec(part);
        if (channel >= uint32_t(std::max(spec.nchannels, 0)))
            throw Failure { OIIO_BORDER_ABSENT, "the part has no channel " + std::to_string(channel) };
        *format = format_of(spec.channelformat(int(channel)));
        copy_text(std::string(spec.channel_name(int(channel))), name, name_size);
    });
}

int oiio_border_attribute(OiioBorderInput* input, uint32_t part, const char* name, char* text, size_t text_size,
                          char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_BAD_IMAGE, message, message_size, [&] {
        if (!input || !name)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        const OIIO::ImageSpec spec    = input->spec(part);
        const OIIO::ParamValue* value = spec.find_attribute(name);
        if (!value)
            throw Failure { OIIO_BORDER_ABSENT, std::string("the part has no attribute ") + name };
        copy_text(value->get_string(), text, text_size);
    });
}

int oiio_border_read(OiioBorderInput* input, uint32_t part, uint32_t level, uint32_t channels, uint32_t format,
                     void* pixels, size_t byte_count, size_t limit, char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_CANNOT_READ, message, message_size, [&] {
        if (!input || !pixels)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        const OIIO::ImageSpec spec = input->spec(part, level);
        if (spec.width <= 0 || spec.height <= 0 || spec.depth > 1 || spec.deep)
            throw Failure { OIIO_BORDER_BAD_IMAGE, "not a flat image with pixels" };
        if (channels == 0 || channels > uint32_t(spec.nchannels))
            throw Failure { OIIO_BORDER_MISUSE, "the part has other channels" };
        const OIIO::TypeDesc type = type_of(format);
        // Width and height are at most 2^31, so that their product fits; dividing avoids the next overflow.
        const uint64_t texels = uint64_t(spec.width) * uint64_t(spec.height);
        const uint64_t texel  = uint64_t(channels) * uint64_t(type.size());
        if (texels > uint64_t(limit) / texel)
            throw Failure { OIIO_BORDER_TOO_LARGE, "the image takes too much memory" };
        if (texels * texel != uint64_t(byte_count))
            throw Failure { OIIO_BORDER_MISUSE, "the buffer has another size" };
        if (!input->input->read_image(int(part), int(level), 0, int(channels), type, pixels))
            throw Failure { OIIO_BORDER_CANNOT_READ, or_unknown(input->input->geterror()) };
    });
}

void oiio_border_close(OiioBorderInput* input)
{
    (void)guarded(OIIO_BORDER_CANNOT_READ, nullptr, 0, [&] { delete input; });
}

int oiio_border_create(const char* file, const char* format, const OiioBorderPicture* picture,
                       OiioBorderOutput** output, char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_CANNOT_WRITE, message, message_size, [&] {
        if (!file || !format || !picture || !output || picture->part_count == 0)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer, or no part" };
        *output      = nullptr;
        auto made    = std::make_unique<OiioBorderOutput>();
        made->name   = file;
        made->output = OIIO::ImageOutput::create(format);
        if (!made->output)
            throw Failure { OIIO_BORDER_CANNOT_WRITE, or_unknown(OIIO::geterror()) };

        // Describe every part: multi-part files need all headers at once.
        for (size_t p = 0; p < picture->part_count; ++p) {
            const OiioBorderPart& part = picture->parts[p];
            OIIO::ImageSpec spec(int(picture->width), int(picture->height), int(part.channel_count));
            spec.x           = picture->x;
            spec.y           = picture->y;
            spec.full_width  = int(picture->full_width);
            spec.full_height = int(picture->full_height);
            spec.tile_width = spec.tile_height = int(picture->tile);
            spec.tile_depth                    = 1;
            spec.channelnames.clear();
            spec.alpha_channel = spec.z_channel = -1;
            std::vector<OIIO::TypeDesc> types;
            for (size_t c = 0; c < part.channel_count; ++c) {
                const std::string name = part.channels[c].name;
                if (name == "A")
                    spec.alpha_channel = int(c);
                if (name == "Z")
                    spec.z_channel = int(c);
                spec.channelnames.push_back(name);
                types.push_back(type_of(part.channels[c].format));
            }
            const bool mixed = std::any_of(types.begin(), types.end(),
                                           [&](OIIO::TypeDesc type) { return type != types.front(); });
            spec.set_format(mixed || types.empty() ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : types.front());
            if (mixed)
                spec.channelformats = types;
            if (part.name && *part.name)
                spec.attribute("oiio:subimagename", std::string(part.name));
            if (picture->compression)
                spec.attribute("compression", std::string(picture->compression));
            // OpenImageIO writes the time of the day into OpenEXR files that name none: one picture would give
            // other bytes with each second.
            if (std::strcmp(made->output->format_name(), "openexr") == 0)
                spec.attribute("DateTime", std::string());
            for (size_t a = 0; a < picture->attribute_count; ++a) {
                const OiioBorderAttribute& attribute = picture->attributes[a];
                switch (attribute.kind) {
                case OIIO_BORDER_INT: spec.attribute(attribute.name, int(attribute.integer)); break;
                case OIIO_BORDER_REAL: spec.attribute(attribute.name, attribute.real[0]); break;
                case OIIO_BORDER_TEXT:
                    spec.attribute(attribute.name, std::string(attribute.text ? attribute.text : ""));
                    break;
                case OIIO_BORDER_MATRIX:
                    spec.attribute(attribute.name, OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, OIIO::TypeDesc::MATRIX44),
                                   attribute.real);
                    break;
                default: throw Failure { OIIO_BORDER_MISUSE, "unknown kind of attribute" };
                }
            }
            made->specs.push_back(std::move(spec));
        }

        // Make the file.
        made->file = std::make_unique<CheckedFile>(file);
        if (!made->output->set_ioproxy(made->file.get()))
            made->fail();
        if (made->specs.size() > 1) {
            // OpenImageIO 2.4's multi-part writer ignores the proxy and opens the name itself, out of sight of our
            // checks. It gets memory for that; `finish` copies it. Versions that know better leave it empty.
            made->memory = ::memfd_create("picture", MFD_CLOEXEC);
            if (made->memory < 0)
                throw Failure { OIIO_BORDER_CANNOT_WRITE, std::strerror(errno) };
            made->name = "/proc/self/fd/" + std::to_string(made->memory);
        }
        const bool opened = made->specs.size() == 1
                                ? made->output->open(made->name, made->specs[0])
                                : made->output->open(made->name, int(made->specs.size()), made->specs.data());
        if (!opened)
            made->fail();
        made->file->check();
        *output = made.release();
    });
}

int oiio_border_write(OiioBorderOutput* output, uint32_t rows, const void* pixels, size_t byte_count,
                      char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_CANNOT_WRITE, message, message_size, [&] {
        if (!output || !pixels)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        if (output->row == uint32_t(output->specs[output->part].height)) {
            if (output->part + 1 == output->specs.size())
                throw Failure { OIIO_BORDER_MISUSE, "more rows than the picture has" };
            output->part += 1;
            output->row = 0;
            if (!output->output->open(output->name, output->specs[output->part],
                                      OIIO::ImageOutput::AppendSubimage))
                output->fail();
        }
        // The caller's description, not the writer's, that may have changed what it cannot store.
        const OIIO::ImageSpec& spec = output->specs[output->part];
        if (rows == 0 || rows > uint32_t(spec.height) - output->row)
            throw Failure { OIIO_BORDER_MISUSE, "the band of rows does not fit the picture" };
        if (spec.pixel_bytes(true) * size_t(spec.width) * rows != byte_count
            || output->output->spec().pixel_bytes(true) != spec.pixel_bytes(true))
            throw Failure { OIIO_BORDER_MISUSE, "the buffer has another size" };
        const int begin = spec.y + int(output->row);
        const int end   = begin + int(rows);
        // Unknown says that each channel comes in its own format. Only there: some writers of OpenImageIO 2.5 take a
        // pixel of unknown format to be 0 bytes wide, and write the first one of each row all over it.
        const OIIO::TypeDesc type = spec.channelformats.empty() ? spec.format : OIIO::TypeDesc();
        const bool written = spec.tile_width > 0
                                 ? output->output->write_tiles(spec.x, spec.x + spec.width, begin, end, 0, 1, type,
                                                               pixels)
                                 : output->output->write_scanlines(begin, end, 0, type, pixels);
        if (!written)
            output->fail();
        output->file->check();
        output->row += rows;
    });
}

int oiio_border_finish(OiioBorderOutput* output, char* message, size_t message_size)
{
    return guarded(OIIO_BORDER_CANNOT_WRITE, message, message_size, [&] {
        if (!output)
            throw Failure { OIIO_BORDER_MISUSE, "null pointer" };
        std::unique_ptr<OiioBorderOutput> ended(output);
        if (ended->part + 1 != ended->specs.size()
            || ended->row != uint32_t(ended->specs[ended->part].height))
            throw Failure { OIIO_BORDER_MISUSE, "rows are missing" };
        if (!ended->output->close())
            ended->fail();
        // Destroying the writer may write its last bytes.
        ended->output.reset();
        if (ended->memory >= 0 && ended->file->size() == 0)
            ended->copy_memory();
        if (ended->file->size() == 0)
            throw Failure { OIIO_BORDER_CANNOT_WRITE, "OpenImageIO has written nothing" };
        ended->file->finish();
    });
}

void oiio_border_abandon(OiioBorderOutput* output)
{
    (void)guarded(OIIO_BORDER_CANNOT_WRITE, nullptr, 0, [&] { delete output; });
}
