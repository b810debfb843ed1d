// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteMesh.H"
#include "cellModel.H"
#include "cellShape.H"

namespace
{

//- The server's name for a cell of this shape, or null if it has none. The
//  order of the points is the server's in each.
const char* typeOf(const Foam::cellShape& shape)
{
    switch (shape.model().index())
    {
        case Foam::cellModel::HEX: return "hexahedron";
        case Foam::cellModel::PRISM: return "wedge";
        case Foam::cellModel::PYR: return "pyramid";
        case Foam::cellModel::TET: return "tetra";
        default: return nullptr;
    }
}

bool isLeftHanded
(
    const Foam::point& a,
    const Foam::point& b,
    const Foam::point& c,
    const Foam::point& d
)
{
    return (((b - a) ^ (c - a)) & (d - a)) <= 0;
}

} // End anonymous namespace


void Foam::remoteMesh::numberCentres()
{
    if (dimension() == 2)
    {
        for (const label facei : planeFaces())
        {
            if (isLong(facei))
            {
                addMiddle(facei);
            }
        }
        return;
    }
    DynamicList<label> divided;
    forAll(mesh_.cells(), celli)
    {
        if (!typeOf(mesh_.cellShapes()[celli]))
        {
            divided.append(celli);
            for (const label facei : mesh_.cells()[celli])
            {
                if (isLong(facei))
                {
                    addMiddle(facei);
                }
            }
        }
    }
    for (const label celli : divided)
    {
        cellNode_.insert
        (
            celli,
            nodePoint_.size() + middles_.size() + cellNode_.size()
        );
    }
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


void Foam::remoteMesh::checkSeen
(
    const face& f,
    const label facei,
    const label celli
) const
{
    const pointField& points = mesh_.points();
    const point& centre = mesh_.cellCentres()[celli];
    const point middle(meanOf(f, points));
    forAll(f, i)
    {
        const label third = f.size() > 4 ? -1 : f.prevLabel(i);
        const point& corner = third < 0 ? middle : points[third];
        if (isLeftHanded(points[f[i]], points[f.nextLabel(i)], corner, centre))
        {
            FatalErrorInFunction
                << "polyhedral cell " << celli << " at " << centre
                << " cannot be judged: its face " << facei
                << " is not seen as a whole from the cell's centre" << nl
                << "    a cell that is no hexahedron, prism, pyramid or "
                << "tetrahedron is divided about its centre"
                << exit(FatalError);
        }
    }
}


void Foam::remoteMesh::addPieces(const label celli)
{
    const label centre = cellNode_[celli];
    for (const label facei : mesh_.cells()[celli])
    {
        // anticlockwise as seen from the centre
        const face& out = mesh_.faces()[facei];
        const face f
        (
            mesh_.faceOwner()[facei] == celli ? out.reverseFace() : out
        );
        checkSeen(f, facei, celli);
        if (f.size() == 3)
        {
            addCell("tetra", labelList({f[0], f[1], f[2], centre}), celli);
        }
        else if (f.size() == 4)
        {
            const labelList pyramid({f[0], f[1], f[2], f[3], centre});
            addCell("pyramid", pyramid, celli);
        }
        else
        {
            const label middle = faceNode_[facei];
            forAll(f, i)
            {
                const labelList tetra({f[i], f.nextLabel(i), middle, centre});
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
    if (f.size() <= 4)
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
        const char* type = typeOf(shape);
        if (type)
        {
            addCell(type, shape, celli);
        }
        else
        {
            addPieces(celli);
        }
    }
}
