// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteMesh.H"
#include "cellModel.H"
#include "cellShape.H"
#include "syncTools.H"

namespace
{

//- The server's name for a cell of this shape, or null if it has none. The
//  points have the server's order in each cell.
const char* typeOf(const Foam::cellShape& shape)
{
    const Foam::word& name = shape.model().name();
    return
        name == "hex" ? "hexahedron"
      : name == "prism" ? "wedge"
      : name == "pyr" ? "pyramid"
      : name == "tet" ? "tetra"
      : nullptr;
}

//- For each corner of such a cell: the corner and its neighbours, right-handed
const Foam::labelListList& cornersOf(const Foam::cellShape& shape)
{
    using Foam::labelList;
    static const Foam::labelListList hex
    ({
        labelList({0, 1, 3, 4}), labelList({1, 2, 0, 5}),
        labelList({2, 3, 1, 6}), labelList({3, 0, 2, 7}),
        labelList({4, 7, 5, 0}), labelList({5, 4, 6, 1}),
        labelList({6, 5, 7, 2}), labelList({7, 6, 4, 3})
    });
    static const Foam::labelListList prism
    ({
        labelList({0, 1, 2, 3}), labelList({1, 2, 0, 4}),
        labelList({2, 0, 1, 5}), labelList({3, 5, 4, 0}),
        labelList({4, 3, 5, 1}), labelList({5, 4, 3, 2})
    });
    static const Foam::labelListList pyramid
    ({
        labelList({0, 1, 3, 4}), labelList({1, 2, 0, 4}),
        labelList({2, 3, 1, 4}), labelList({3, 0, 2, 4})
    });
    static const Foam::labelListList tetra({labelList({0, 1, 2, 3})});
    const Foam::word& name = shape.model().name();
    return
        name == "hex" ? hex
      : name == "prism" ? prism
      : name == "pyr" ? pyramid
      : tetra;
}

//- True if one of the determinants is not positive, beyond rounding
bool isNonpositive(const Foam::scalarUList& determinants)
{
    const Foam::scalar largest =
        Foam::max(Foam::max(determinants), -Foam::min(determinants));
    return Foam::min(determinants) <= 1e-12*largest;
}

//- True if a cell of a simple type has an inverted corner
bool isCrossed(const Foam::cellShape& shape, const Foam::pointField& points)
{
    Foam::scalarList determinants;
    for (const Foam::labelList& corner : cornersOf(shape))
    {
        const Foam::point& at = points[shape[corner[0]]];
        const Foam::vector a = points[shape[corner[1]]] - at;
        const Foam::vector b = points[shape[corner[2]]] - at;
        const Foam::vector c = points[shape[corner[3]]] - at;
        determinants.append((a ^ b) & c);
    }
    return isNonpositive(determinants);
}

} // End anonymous namespace


void Foam::remoteMesh::numberCentres(const pointField& base)
{
    if (dimension() == 2)
    {
        for (const label facei : planeFaces())
        {
            const face& f = mesh_.faces()[facei];
            if (f.size() > 4 || diagonal(f, base)[0] >= 0)
            {
                addMiddle(facei, base);
            }
        }
        return;
    }
    boolList divided(mesh_.nCells()), split(mesh_.nFaces(), false);
    forAll(divided, celli)
    {
        const cellShape& shape = mesh_.cellShapes()[celli];
        divided[celli] = !typeOf(shape) || isCrossed(shape, base);
    }
    // a split face also divides the cell on its other side; this may split
    // other faces, also on other ranks
    boolList seen(mesh_.nCells(), false);
    Map<point> found;
    bool again = true;
    while (again)
    {
        forAll(divided, celli)
        {
            if (divided[celli] && !seen[celli])
            {
                seen[celli] = true;
                splitFaces(celli, base, split, found);
            }
        }
        syncTools::syncFaceList(mesh_, split, orEqOp<bool>());
        again = false;
        forAll(split, facei)
        {
            if (split[facei])
            {
                const label celli = mesh_.faceOwner()[facei];
                again = again || !divided[celli];
                divided[celli] = true;
                if (mesh_.isInternalFace(facei))
                {
                    const label other = mesh_.faceNeighbour()[facei];
                    again = again || !divided[other];
                    divided[other] = true;
                }
            }
        }
        reduce(again, orOp<bool>());
    }
    forAll(split, facei)
    {
        if (split[facei])
        {
            addMiddle(facei, base);
        }
    }
    forAll(divided, celli)
    {
        if (divided[celli])
        {
            cellNode_.insert
            (
                celli,
                nodePoint_.size() + middles_.size() + cellNode_.size()
            );
            centres_.append(found[celli]);
        }
    }
}


void Foam::remoteMesh::splitFaces
(
    const label celli,
    const pointField& base,
    boolList& split,
    Map<point>& found
) const
{
    const cell& faces = mesh_.cells()[celli];
    const point centre(faces.centre(base, mesh_.faces()));
    bool all = false; // if a triangle is hidden
    for (const label facei : faces)
    {
        const face f(inwards(facei, celli));
        scalarList heights(f.size());
        forAll(f, i)
        {
            const point& at = base[f[i]];
            const vector after = base[f.nextLabel(i)] - at;
            heights[i] = (after ^ (base[f.prevLabel(i)] - at)) & (centre - at);
        }
        if (f.size() > 4 || (f.size() == 4 && isNonpositive(heights)))
        {
            split[facei] = true;
        }
        if (f.size() == 3 || split[facei])
        {
            const point middle(meanOf(f, base, diagonal(f, base)));
            forAll(f, i)
            {
                const point& at = base[f[i]];
                const vector normal = (base[f.nextLabel(i)] - at) ^ (middle - at);
                all = all || (normal & (centre - at)) <= 0;
            }
        }
    }
    if (all)
    {
        for (const label facei : faces)
        {
            split[facei] = split[facei] || mesh_.faces()[facei].size() == 4;
        }
    }
    found.insert(celli, all ? seeingAll(celli, base) : centre);
}


Foam::point Foam::remoteMesh::seeingAll
(
    const label celli,
    const pointField& base
) const
{
    const cell& faces = mesh_.cells()[celli];
    const point centre(faces.centre(base, mesh_.faces()));
    DynamicList<vector> normals;
    DynamicList<point> corners;
    for (const label facei : faces)
    {
        const face f(inwards(facei, celli));
        const point middle(meanOf(f, base, diagonal(f, base)));
        forAll(f, i)
        {
            const point& at = base[f[i]];
            const vector normal = (base[f.nextLabel(i)] - at) ^ (middle - at);
            normals.append(normal/(mag(normal) + VSMALL));
            corners.append(at);
        }
    }
    const scalar size = boundBox(corners, false).mag();
    for (scalar depth = 0.1*size; depth > 1e-4*size; depth /= 2)
    {
        point at(centre);
        for (label step = 0; step < 200; ++step)
        {
            label worst = 0;
            scalar least = GREAT;
            forAll(normals, i)
            {
                const scalar height = normals[i] & (at - corners[i]);
                if (height < least)
                {
                    least = height;
                    worst = i;
                }
            }
            if (least >= depth)
            {
                return at;
            }
            at += 1.9*(depth - least)*normals[worst];
        }
    }
    FatalErrorInFunction
        << "cell " << celli << " at " << centre << " cannot be judged: no "
        << "point in it sees all of its faces" << nl
        << "    a cell that is no valid hexahedron, prism, pyramid or "
        << "tetrahedron is divided about such a point"
        << exit(FatalError);
    return centre;
}


Foam::face Foam::remoteMesh::inwards(const label facei, const label celli) const
{
    const face& out = mesh_.faces()[facei];
    return mesh_.faceOwner()[facei] == celli ? out.reverseFace() : out;
}


void Foam::remoteMesh::addCell
(
    const char* type,
    const labelUList& nodes,
    const label celli
)
{
    block& cells = cells_[type];
    cells.nodes.insert(cells.nodes.end(), nodes.begin(), nodes.end());
    cells.cells.push_back(celli);
}


void Foam::remoteMesh::addPieces(const label celli)
{
    const label centre = cellNode_[celli];
    for (const label facei : mesh_.cells()[celli])
    {
        const face f(inwards(facei, celli));
        if (f.size() == 3)
        {
            addCell("tetra", labelList({f[0], f[1], f[2], centre}), celli);
        }
        else if (!faceNode_.found(facei))
        {
            const labelList pyramid({f[0], f[1], f[2], f[3], centre});
            addCell("pyramid", pyramid, celli);
        }
        else
        {
            forAll(f, i)
            {
                const labelList tetra
                ({
                    f[i], f.nextLabel(i), faceNode_[facei], centre
                });
                addCell("tetra", tetra, celli);
            }
        }
    }
}


void Foam::remoteMesh::addPolygon(const label facei)
{
    const label celli = mesh_.faceOwner()[facei];
    face f(mesh_.faces()[facei]);
    if (axes_[1] - axes_[0] == 2)
    {
        f.flip(); // anticlockwise about y is clockwise in (x z)
    }
    inplaceRenumber(pointNode_, f);
    if (!faceNode_.found(facei))
    {
        addCell(f.size() == 3 ? "triangle" : "quad", f, celli);
        return;
    }
    forAll(f, i)
    {
        const labelList piece({f[i], f.nextLabel(i), faceNode_[facei]});
        addCell("triangle", piece, celli);
    }
}


void Foam::remoteMesh::addCells()
{
    if (dimension() == 2)
    {
        for (const label facei : planeFaces())
        {
            addPolygon(facei);
        }
        return;
    }
    forAll(mesh_.cells(), celli)
    {
        const cellShape& shape = mesh_.cellShapes()[celli];
        if (!cellNode_.found(celli))
        {
            addCell(typeOf(shape), shape, celli);
        }
        else
        {
            addPieces(celli);
        }
    }
}
