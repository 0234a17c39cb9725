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

    // Position and both derivatives at each place, nine numbers; how many places are on the surface.
    int evaluate(int count, int const *faces, Real const *uvs, Real *out) const {
        int found = 0;
        Real w[20], wu[20], wv[20];
        for (int i = 0; i < count; ++i, out += 9) {
            Real u = uvs[2 * i], v = uvs[2 * i + 1];
            Far::PatchTable::PatchHandle const *handle = map->FindPatch(faces[i], u, v);
            if (!handle) continue;
            ++found;
            table->EvaluateBasis(*handle, u, v, w, wu, wv);
            Far::ConstIndexArray cvs = table->GetPatchVertices(*handle);
            Point<Real> p, du, dv;
            p.Clear(), du.Clear(), dv.Clear();
            for (int k = 0; k < cvs.size(); ++k) {
                Point<Real> const &q = points[cvs[k]];
                p.AddWithWeight(q, w[k]);
                du.AddWithWeight(q, wu[k]);
                dv.AddWithWeight(q, wv[k]);
            }
            for (int k = 0; k < 3; ++k) out[k] = p.x[k], out[3 + k] = du.x[k], out[6 + k] = dv.x[k];
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
int far_border_evaluate_f32(void const *surface, int count, int const *faces, float const *uvs, float *out) {
    return static_cast<Surface<float> const *>(surface)->evaluate(count, faces, uvs, out);
}
int far_border_evaluate_f64(void const *surface, int count, int const *faces, double const *uvs, double *out) {
    return static_cast<Surface<double> const *>(surface)->evaluate(count, faces, uvs, out);
}
void far_border_delete_f32(void *surface) { delete static_cast<Surface<float> *>(surface); }
void far_border_delete_f64(void *surface) { delete static_cast<Surface<double> *>(surface); }
}
