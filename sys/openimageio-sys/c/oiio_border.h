/* A C border over the few things of OpenImageIO that a renderer needs: read an image, write one.

   No C++ exception and no C++ type crosses it. Every function that can fail returns 0 when all is well and
   else one of the codes below; then it has written the reason, always terminated by a zero, into the buffer
   `message` of `message_size` bytes that the caller owns. There is no state outside of the handles. */
#ifndef OIIO_BORDER_H
#define OIIO_BORDER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    OIIO_BORDER_OK = 0,
    /* No reader knows the format, or the reader refuses the header. */
    OIIO_BORDER_CANNOT_OPEN = 1,
    /* The header says something that cannot be: no pixels, no channels, or deep samples. */
    OIIO_BORDER_BAD_IMAGE = 2,
    /* The pixels would take more memory than the caller allows. */
    OIIO_BORDER_TOO_LARGE = 3,
    /* The pixels, or some of them, could not be read: the file is cut off or damaged. */
    OIIO_BORDER_CANNOT_READ = 4,
    /* The file could not be made or written to its end. */
    OIIO_BORDER_CANNOT_WRITE = 5,
    /* The call itself is wrong: a bug of the caller. */
    OIIO_BORDER_MISUSE = 6,
    /* There is no such part, channel or attribute. */
    OIIO_BORDER_ABSENT = 7,
    /* The system has no more memory. */
    OIIO_BORDER_NO_MEMORY = 8
};

/* What a channel's numbers are. In a file that is read, all formats not named here count as float:
   whole numbers are then scaled to 0..1. UINT32 and UINT16 are only there for who asks for them. */
enum {
    OIIO_BORDER_UINT8 = 0,
    OIIO_BORDER_HALF = 1,
    OIIO_BORDER_FLOAT = 2,
    OIIO_BORDER_UINT32 = 3,
    OIIO_BORDER_UINT16 = 4
};

/* OpenImageIO's version, "2.4.7.1". */
void oiio_border_version(char* text, size_t text_size);

/* Adds a reader to OpenImageIO's registry: the format's name, endings of file names with a null at the end, the
   version of what reads it, and a function that makes a new OIIO::ImageInput. OpenImageIO keeps the pointers. What
   comes first has an ending: to be called before anything else of OpenImageIO, which adds its own readers when it is
   first asked for one, and here right behind this one. Not while another thread uses OpenImageIO. */
int oiio_border_declare(const char* name, const char* const* endings, const char* version, void* (*create)(void),
                        char* message, size_t message_size);

/* ---- Reading ---- */

typedef struct OiioBorderInput OiioBorderInput;

typedef struct OiioBorderInfo {
    /* The data window. */
    uint32_t width, height;
    int32_t x, y;
    /* The display window. */
    uint32_t full_width, full_height;
    int32_t full_x, full_y;
    uint32_t channels;
    /* The format that holds every channel without loss, one of OIIO_BORDER_UINT8, _HALF, _FLOAT. */
    uint32_t format;
    /* The index of these channels, or -1. */
    int32_t alpha_channel, depth_channel;
    /* OpenImageIO's oiio:ColorSpace; empty if the file says nothing. */
    char color_space[64];
} OiioBorderInfo;

/* Opens the file `name`; or, if `bytes` is not null, those bytes, of which `name` then only tells the format by
   its ending. The bytes are borrowed until oiio_border_close. Alpha is left as the file has it: colours of
   formats with unassociated alpha are not multiplied by it. */
int oiio_border_open(const char* name, const uint8_t* bytes, size_t byte_count, OiioBorderInput** input,
                     char* message, size_t message_size);

/* The header of a level of the part (subimage). Level 0 is the full size, those behind it are MIP levels, where the
   file has some. Fails with OIIO_BORDER_ABSENT where it has not, and with OIIO_BORDER_BAD_IMAGE when the header
   describes no flat picture. */
int oiio_border_info(OiioBorderInput* input, uint32_t part, uint32_t level, OiioBorderInfo* info, char* message,
                     size_t message_size);

/* Channel `channel` of the part: its name, and its format in the file as in OiioBorderInfo (or UINT32). */
int oiio_border_channel(OiioBorderInput* input, uint32_t part, uint32_t channel, uint32_t* format, char* name,
                        size_t name_size, char* message, size_t message_size);

/* The attribute `name` of the part, as text. */
int oiio_border_attribute(OiioBorderInput* input, uint32_t part, const char* name, char* text, size_t text_size,
                          char* message, size_t message_size);

/* The first `channels` channels of a level of the part, interleaved, row 0 on top, converted to `format`. `pixels`
   has exactly `byte_count` bytes; more than `limit` is refused. */
int oiio_border_read(OiioBorderInput* input, uint32_t part, uint32_t level, uint32_t channels, uint32_t format,
                     void* pixels, size_t byte_count, size_t limit, char* message, size_t message_size);

/* Null is allowed. */
void oiio_border_close(OiioBorderInput* input);

/* ---- Writing ---- */

typedef struct OiioBorderOutput OiioBorderOutput;

typedef struct OiioBorderChannel {
    const char* name;
    uint32_t format;
} OiioBorderChannel;

typedef struct OiioBorderPart {
    /* May be empty if the file has one part only. */
    const char* name;
    const OiioBorderChannel* channels;
    size_t channel_count;
} OiioBorderPart;

enum {
    OIIO_BORDER_INT = 0,
    OIIO_BORDER_REAL = 1,
    OIIO_BORDER_TEXT = 2,
    OIIO_BORDER_MATRIX = 3
};

typedef struct OiioBorderAttribute {
    const char* name;
    uint32_t kind;
    int32_t integer;
    /* The number in [0], or the matrix, row by row. */
    float real[16];
    /* Null unless `kind` is OIIO_BORDER_TEXT. */
    const char* text;
} OiioBorderAttribute;

typedef struct OiioBorderPicture {
    /* The data window, and its place in the display window, which starts at 0, 0. */
    uint32_t width, height;
    int32_t x, y;
    uint32_t full_width, full_height;
    /* 0 for scanlines. */
    uint32_t tile;
    /* OpenImageIO's name for it; null for the format's default. */
    const char* compression;
    const OiioBorderPart* parts;
    size_t part_count;
    /* Every part gets them all. */
    const OiioBorderAttribute* attributes;
    size_t attribute_count;
} OiioBorderPicture;

/* Makes `file` (an existing one is emptied) in the format with this name, "openexr" or "png". What `picture` points to is copied. */
int oiio_border_create(const char* file, const char* format, const OiioBorderPicture* picture,
                       OiioBorderOutput** output, char* message, size_t message_size);

/* The next `rows` rows of the current part; a part that is full is followed by the next. With tiles, `rows` is a
   multiple of the tile's height except at the bottom. `pixels`: every channel in its own format, packed. */
int oiio_border_write(OiioBorderOutput* output, uint32_t rows, const void* pixels, size_t byte_count,
                      char* message, size_t message_size);

/* Ends the file and frees the handle, whether or not it succeeds. All is on its way to the disk only if this
   returns 0. */
int oiio_border_finish(OiioBorderOutput* output, char* message, size_t message_size);

/* Frees the handle; what was written so far is worthless. Null is allowed. */
void oiio_border_abandon(OiioBorderOutput* output);

#ifdef __cplusplus
}
#endif
#endif
