// Far's way to limit points: adaptive refinement and a patch table made beforehand, then for each place the patch by
// PatchMap, its weights by EvaluateBasis, and their sum over the points. No exception crosses the border.

#include <opensubdiv/far/patchMap.h>
#include <opensubdiv/far/patchTableFactory.h>
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

#include <cstddef>
#include <memory>
#include <vector>

using namespace OpenSubdiv;

namespace {

template <class Real> struct Point {
    Real x[3];
    void Clear(void * = nullptr) { x[0] = x[1] = x[2] = 0; }
    void AddWithWeight(Point const &p, Real w) {
        for (int i = 0; i < 3; ++i) x[i] += w * p.x[i];
    }
};

template <class Real> struct Surface {
    std::unique_ptr<Far::PatchTable> table;
    std::unique_ptr<Far::PatchMap> map;
    std::vector<Point<Real>> points;

    Surface(bool loop, int vertices, int faces, int const *counts, int const *indices, float const *positions,
            int level) {
        typedef Far::TopologyDescriptor Descriptor;
        Descriptor d;
        d.numVertices = vertices;
        d.numFaces = faces;
        d.numVertsPerFace = counts;
        d.vertIndicesPerFace = indices;
        Sdc::Options rules;
        rules.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER);
        Far::TopologyRefinerFactory<Descriptor>::Options creation(loop ? Sdc::SCHEME_LOOP : Sdc::SCHEME_CATMARK, rules);
        std::unique_ptr<Far::TopologyRefiner> refiner(
            Far::TopologyRefinerFactory<Descriptor>::Create(d, creation));

        Far::PatchTableFactory::Options options(level);
        options.SetPatchPrecision<Real>();
        options.useInfSharpPatch = true;
        options.SetEndCapType(Far::PatchTableFactory::Options::ENDCAP_GREGORY_BASIS);
        refiner->RefineAdaptive(options.GetRefineAdaptiveOptions());
        table.reset(Far::PatchTableFactory::Create(*refiner, options));
        map.reset(new Far::PatchMap(*table));

        int refined = refiner->GetNumVerticesTotal();
        points.resize(refined + table->GetNumLocalPoints());
        for (int v = 0; v < vertices; ++v)
            for (int i = 0; i < 3; ++i) points[v].x[i] = positions[3 * v + i];
        Far::PrimvarRefinerReal<Real> primvars(*refiner);
        Point<Real> *source = points.data();
        for (int l = 1; l < refiner->GetNumLevels(); ++l) {
            Point<Real> *target = source + refiner->GetLevel(l - 1).GetNumVertices();
            primvars.Interpolate(l, source, target);
            source = target;
        }
        if (table->GetNumLocalPoints())
            table->GetLocalPointStencilTable<Real>()->UpdateValues(points.data(), points.data() + refined);
    }

    // At each place the position and the derivatives by u and v, and if N is 6 those by uu, uv and vv; how many places
    // are on the surface.
    template <int N> int evaluate(int count, int const *faces, Real const *uvs, Real *out) const {
        int found = 0;
        Real w[6][20];
        for (int i = 0; i < count; ++i, out += 3 * N) {
            Real u = uvs[2 * i], v = uvs[2 * i + 1];
            Far::PatchTable::PatchHandle const *handle = map->FindPatch(faces[i], u, v);
            if (!handle) continue;
            ++found;
            if (N == 3)
                table->EvaluateBasis(*handle, u, v, w[0], w[1], w[2]);
            else
                table->EvaluateBasis(*handle, u, v, w[0], w[1], w[2], w[3], w[4], w[5]);
            Far::ConstIndexArray cvs = table->GetPatchVertices(*handle);
            Point<Real> sums[N];
            for (int n = 0; n < N; ++n) sums[n].Clear();
            for (int k = 0; k < cvs.size(); ++k) {
                Point<Real> const &q = points[cvs[k]];
                for (int n = 0; n < N; ++n) sums[n].AddWithWeight(q, w[n][k]);
            }
            for (int n = 0; n < N; ++n)
                for (int k = 0; k < 3; ++k) out[3 * n + k] = sums[n].x[k];
        }
        return found;
    }
};

template <class Real>
void *create(int loop, int vertices, int faces, int const *counts, int const *indices, float const *positions,
             int level) {
    try {
        return new Surface<Real>(loop != 0, vertices, faces, counts, indices, positions, level);
    } catch (...) {
        return nullptr;
    }
}

template <class Real>
int evaluate(void const *surface, int second, int count, int const *faces, Real const *uvs, Real *out) {
    auto const &s = *static_cast<Surface<Real> const *>(surface);
    return second ? s.template evaluate<6>(count, faces, uvs, out) : s.template evaluate<3>(count, faces, uvs, out);
}

} // namespace

extern "C" {

void *far_border_create_f32(int loop, int vertices, int faces, int const *counts, int const *indices,
                            float const *positions, int level) {
    return create<float>(loop, vertices, faces, counts, indices, positions, level);
}
void *far_border_create_f64(int loop, int vertices, int faces, int const *counts, int const *indices,
                            float const *positions, int level) {
    return create<double>(loop, vertices, faces, counts, indices, positions, level);
}
int far_border_evaluate_f32(void const *surface, int second, int count, int const *faces, float const *uvs,
                            float *out) {
    return evaluate(surface, second, count, faces, uvs, out);
}
int far_border_evaluate_f64(void const *surface, int second, int count, int const *faces, double const *uvs,
                            double *out) {
    return evaluate(surface, second, count, faces, uvs, out);
}
void far_border_delete_f32(void *surface) { delete static_cast<Surface<float> *>(surface); }
void far_border_delete_f64(void *surface) { delete static_cast<Surface<double> *>(surface); }
}
