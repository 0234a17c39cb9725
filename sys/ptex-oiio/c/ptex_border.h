/* The C border between OpenImageIO's idea of a file reader, ptex_input.cpp, and the Ptex reader in Rust.

   What is called ptex_border_* is written in Rust, in src/lib.rs. No panic crosses it. A function that can fail
   returns 0 when all is well and else one of the codes below; then it has written the reason, always terminated by a
   zero, into the buffer `message` of `message_size` bytes that the caller owns. There is no state outside of the
   handles, and any number of threads may use one at once, until it is closed. */
#ifndef PTEX_BORDER_H
#define PTEX_BORDER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PTEX_BORDER_OK = 0,
    /* There is no such face, or it has not so many levels. */
    PTEX_BORDER_ABSENT = 1,
    /* The file, or that part of it, cannot be read. */
    PTEX_BORDER_FAILED = 2,
    /* The call itself is wrong: a bug of the caller. */
    PTEX_BORDER_MISUSE = 3
};

/* What samples and meta data are. */
enum {
    PTEX_BORDER_TEXT = 0,
    PTEX_BORDER_INT8 = 1,
    PTEX_BORDER_INT16 = 2,
    PTEX_BORDER_INT32 = 3,
    PTEX_BORDER_UINT8 = 4,
    PTEX_BORDER_UINT16 = 5,
    PTEX_BORDER_HALF = 6,
    PTEX_BORDER_FLOAT = 7,
    PTEX_BORDER_DOUBLE = 8
};

typedef struct PtexBorderFile PtexBorderFile;

/* One entry of the meta data. */
typedef struct PtexBorderMeta {
    /* Not terminated. */
    const char* key;
    size_t key_size;
    /* TEXT, or one of INT8, INT16, INT32, FLOAT, DOUBLE. */
    uint32_t type;
    /* Bytes of the text, which is not terminated; or numbers. */
    size_t count;
    const void* data;
} PtexBorderMeta;

/* What all faces have in common. All pointers lead into the file's handle. */
typedef struct PtexBorderInfo {
    /* One of UINT8, UINT16, HALF, FLOAT. */
    uint32_t type;
    uint32_t channels;
    /* -1 if there is none. */
    int32_t alpha_channel;
    uint32_t faces;
    /* Not 0 if incremental edits follow the file's first version. */
    uint32_t has_edits;
    /* "quad" or "triangle". */
    const char* mesh_type;
    /* "clamp", "black" or "periodic". */
    const char* u_border;
    const char* v_border;
    const PtexBorderMeta* meta;
    size_t meta_count;
} PtexBorderInfo;

/* The texels of a face at one level, 0 being its full size. */
typedef struct PtexBorderSize {
    uint32_t width, height;
    /* Of the tiles that the file has of it; the whole where it has none. */
    uint32_t tile_width, tile_height;
} PtexBorderSize;

/* Opens the file `name`; or, if `bytes` is not null, takes a copy of those bytes for it. */
int ptex_border_open(const char* name, const uint8_t* bytes, size_t byte_count, PtexBorderFile** file, char* message,
                     size_t message_size);

/* Null is allowed. */
void ptex_border_close(PtexBorderFile* file);

int ptex_border_info(const PtexBorderFile* file, PtexBorderInfo* info, char* message, size_t message_size);

/* Levels are halved both ways, down to 1 texel each way. Where the file is too damaged to tell its tiles, the level
   counts as one tile: reading it tells the damage. */
int ptex_border_size(const PtexBorderFile* file, uint32_t face, uint32_t level, PtexBorderSize* size, char* message,
                     size_t message_size);

/* A rectangle of texels, in the file's type and the machine's byte order, interleaved, row y first, premultiplied.
   `pixels` has exactly `byte_count` bytes. */
int ptex_border_read(const PtexBorderFile* file, uint32_t face, uint32_t level, uint32_t x, uint32_t y, uint32_t width,
                     uint32_t height, void* pixels, size_t byte_count, char* message, size_t message_size);

/* The other way, in ptex_input.cpp: a new OIIO::ImageInput, or null if there is no memory for it. */
void* ptex_input_new(void);

#ifdef __cplusplus
}
#endif
#endif
